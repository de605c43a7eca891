//! Compiles every GLSL entry point to SPIR-V with the system's compiler and writes the module that embeds them.

#[path = "src/compile.rs"]
mod compile;

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use compile::Compiled;

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
    let compiler = compile::find_compiler()?;
    let compiled = compile::compile_all(&compiler, &root, &sources, &out)?;
    for line in compiled.iter().flat_map(|shader| shader.warnings.lines()) {
        println!("cargo::warning={line}");
    }
    fs::write(out.join("embedded.rs"), embedding(&compiled)?).map_err(|error| error.to_string())
}

/// Every entry point, sorted; all sources are announced to cargo.
fn sources(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files = compile::files(root)?;
    let folders = compile::FOLDERS.map(|folder| root.join(folder));
    for path in folders.iter().chain(&files) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    files.retain(|path| compile::is_entry(path));
    Ok(files)
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
        let bytes = fs::metadata(&shader.spirv).map_err(|error| format!("{file}: {error}"))?;
        let words = bytes.len() / 4;
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
