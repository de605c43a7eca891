//! Compiles every GLSL entry point to SPIR-V with the system's compiler and writes the module that embeds them.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Folders of entry points, below the crate.
const ENTRY_FOLDERS: [&str; 3] = ["pathtrace", "raster", "tests"];
/// Folder of included files.
const INCLUDE_FOLDER: &str = "common";
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

struct Compiler {
    program: PathBuf,
    dialect: Dialect,
}

/// A shader that compiled.
struct Compiled {
    source: PathBuf,
    spirv: PathBuf,
    bytes: usize,
}

fn main() -> ExitCode {
    println!("cargo::rerun-if-env-changed=CAIRN_GLSLANG");
    println!("cargo::rerun-if-env-changed=PATH");
    match build() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            for line in message.lines() {
                println!("cargo::error={line}");
            }
            ExitCode::FAILURE
        }
    }
}

fn build() -> Result<(), String> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").ok_or("no CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("no OUT_DIR")?);
    let sources = sources(&root)?;
    let compiler = find_compiler().ok_or(MISSING_COMPILER)?;
    let compiled = compile_all(&compiler, &root, &sources, &out)?;
    fs::write(out.join("embedded.rs"), embedding(&compiled)?).map_err(|error| error.to_string())
}

/// Every entry point, sorted; all sources are announced to cargo.
fn sources(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut entries = Vec::new();
    for folder in ENTRY_FOLDERS.iter().chain([&INCLUDE_FOLDER]) {
        let folder = root.join(folder);
        println!("cargo::rerun-if-changed={}", folder.display());
        let listing =
            fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for entry in listing {
            let path = entry.map_err(|error| error.to_string())?.path();
            println!("cargo::rerun-if-changed={}", path.display());
            let extension = path.extension().and_then(|extension| extension.to_str());
            if extension.is_some_and(|extension| STAGES.contains(&extension)) {
                entries.push(path);
            }
        }
    }
    entries.sort();
    Ok(entries)
}

fn find_compiler() -> Option<Compiler> {
    let named = env::var_os("CAIRN_GLSLANG").map(PathBuf::from);
    let in_path = ["glslangValidator", "glslc"].map(PathBuf::from);
    named.into_iter().chain(in_path).find_map(|program| {
        let runs = Command::new(&program).arg("--version").output();
        let name = program.file_stem()?.to_string_lossy().into_owned();
        let dialect = if name.starts_with("glslc") {
            Dialect::Glslc
        } else {
            Dialect::Glslang
        };
        runs.is_ok_and(|output| output.status.success())
            .then_some(Compiler { program, dialect })
    })
}

fn compile_all(
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
    for line in text.lines() {
        println!("cargo::warning={line}");
    }
    let bytes = fs::metadata(&spirv).map_err(|error| format!("{}: {error}", spirv.display()))?;
    Ok(Compiled {
        source: source.to_owned(),
        spirv,
        bytes: bytes.len() as usize,
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

fn embedding(compiled: &[Compiled]) -> Result<String, String> {
    let mut text = String::new();
    let mut names = Vec::new();
    for shader in compiled {
        let file = shader
            .source
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let constant = file.replace(['.', '-'], "_").to_uppercase();
        let words = shader.bytes / 4;
        let _ = writeln!(
            text,
            "/// `{file}`.\npub static {constant}: Shader = Shader {{ name: {file:?}, \
             spirv: &words::<{words}>(include_bytes!({:?})) }};",
            shader.spirv.display().to_string()
        );
        if names.contains(&constant) {
            return Err(format!("two shaders are named {file}"));
        }
        names.push(constant);
    }
    let list: Vec<String> = names.iter().map(|name| format!("&{name}")).collect();
    let _ = writeln!(
        text,
        "/// Every shader, by file name within its folder.\npub static ALL: &[&Shader] = &[{}];",
        list.join(", ")
    );
    Ok(text)
}
