//! Finds the system's GLSL compiler and runs it: when the crate is built, and for hot reload.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Folder of included files.
const INCLUDE_FOLDER: &str = "common";
/// Folders of sources, below the crate.
pub const FOLDERS: [&str; 4] = [INCLUDE_FOLDER, "pathtrace", "raster", "tests"];
/// Extensions of entry points.
const STAGES: [&str; 7] = ["vert", "frag", "comp", "rgen", "rchit", "rahit", "rmiss"];

const MISSING_COMPILER: &str = "no GLSL compiler found: looked at $CAIRN_GLSLANG, then for `glslangValidator` \
     and `glslc` in PATH. Install Debian/Ubuntu package `glslang-tools`, or the Vulkan SDK \
     (https://vulkan.lunarg.com), or set CAIRN_GLSLANG to the path of either program.";

/// A compiler's command line dialect.
#[derive(Clone, Copy, PartialEq)]
enum Dialect {
    Glslang,
    Glslc,
}

/// A compiler that runs.
pub struct Compiler {
    program: PathBuf,
    dialect: Dialect,
}

/// A shader that compiled.
pub struct Compiled {
    pub source: PathBuf,
    pub spirv: PathBuf,
    pub warnings: String,
}

/// Every source below `root`, included files too, sorted.
///
/// # Errors
/// Folders that cannot be read.
pub fn files(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files = Vec::new();
    for folder in FOLDERS.map(|folder| root.join(folder)) {
        let listing =
            fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for entry in listing {
            files.push(entry.map_err(|error| error.to_string())?.path());
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a source is compiled by itself.
pub fn is_entry(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| STAGES.contains(&extension))
}

/// The system's compiler.
///
/// # Errors
/// What to install where there is none.
pub fn find_compiler() -> Result<Compiler, String> {
    let named = env::var_os("CAIRN_GLSLANG").map(PathBuf::from);
    let in_path = ["glslangValidator", "glslc"].map(PathBuf::from);
    let found = named.into_iter().chain(in_path).find_map(|program| {
        let runs = Command::new(&program).arg("--version").output();
        let name = program.file_stem()?.to_string_lossy().into_owned();
        let dialect = if name.starts_with("glslc") {
            Dialect::Glslc
        } else {
            Dialect::Glslang
        };
        runs.is_ok_and(|output| output.status.success())
            .then_some(Compiler { program, dialect })
    });
    found.ok_or_else(|| MISSING_COMPILER.to_owned())
}

/// Compiles `sources` into files of `out`, on every processor.
///
/// # Errors
/// All messages, as `file:line: message`.
pub fn compile_all(
    compiler: &Compiler,
    root: &Path,
    sources: &[PathBuf],
    out: &Path,
) -> Result<Vec<Compiled>, String> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let threads = thread::available_parallelism().map_or(1, |count| count.get());
    thread::scope(|scope| {
        for _ in 0..threads.min(sources.len()) {
            scope.spawn(|| {
                while let Some(source) = sources.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let result = compile(compiler, root, source, out);
                    if let Ok(mut results) = results.lock() {
                        results.push(result);
                    }
                }
            });
        }
    });
    let results = results.into_inner().map_err(|error| error.to_string())?;
    let (good, bad): (Vec<_>, Vec<_>) = results.into_iter().partition(Result::is_ok);
    let mut errors: Vec<String> = bad.into_iter().filter_map(Result::err).collect();
    errors.sort();
    if !errors.is_empty() {
        return Err(errors.join("\n"));
    }
    let mut compiled: Vec<Compiled> = good.into_iter().filter_map(Result::ok).collect();
    compiled.sort_by(|a, b| a.source.cmp(&b.source));
    Ok(compiled)
}

fn compile(
    compiler: &Compiler,
    root: &Path,
    source: &Path,
    out: &Path,
) -> Result<Compiled, String> {
    let file_name = source.file_name().unwrap_or_default();
    let mut spirv = out.join(file_name).into_os_string();
    spirv.push(".spv");
    let spirv = PathBuf::from(spirv);
    let mut include = std::ffi::OsString::from("-I");
    include.push(root.join(INCLUDE_FOLDER));
    let mut command = Command::new(&compiler.program);
    // Names stay in the module (no -g0, no strip): reflection, layer messages and captures show them.
    match compiler.dialect {
        Dialect::Glslang => command.args(["-V", "--target-env", "vulkan1.3"]),
        Dialect::Glslc => command.arg("--target-env=vulkan1.3"),
    };
    command.arg(include).arg("-o").arg(&spirv).arg(source);
    let output = command
        .output()
        .map_err(|error| format!("{}: {error}", compiler.program.display()))?;
    let text = messages(&String::from_utf8_lossy(&output.stdout))
        + &messages(&String::from_utf8_lossy(&output.stderr));
    if !output.status.success() {
        return Err(format!(
            "{}: does not compile\n{}",
            source.display(),
            text.trim_end()
        ));
    }
    Ok(Compiled {
        source: source.to_owned(),
        spirv,
        warnings: text,
    })
}

/// The compiler's messages that name a source line, as `file:line: message`.
fn messages(output: &str) -> String {
    let mut text = String::new();
    for line in output.lines().map(str::trim) {
        let line = line.strip_prefix("ERROR: ").unwrap_or(line);
        let line = line.strip_prefix("WARNING: ").unwrap_or(line);
        let mut numbers = line.split(':').skip(1);
        if numbers.any(|part| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit())) {
            let _ = writeln!(text, "{line}");
        }
    }
    text
}
