//! Hashes the sources, so that the cache's keys change with the code that makes its products.
//!
//! Per module of the library: all of its files, those of every module that it names, and so on; the format crate;
//! the versions of all dependencies; compiler, target and features. Names are found in the text, so a module that
//! is merely mentioned counts: too much is hashed, never too little.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    let root = PathBuf::from(variable("CARGO_MANIFEST_DIR"));
    let sources = root.join("src");
    let modules = modules(&sources);
    let common = common(&root);
    let mut text = String::from(
        "/// Module and hash of what it reaches.\npub const MODULES: &[(&str, &str)] = &[\n",
    );
    for name in modules.keys() {
        let reached = reach(&modules, name);
        let hash = hash(&common, reached.iter().flat_map(|name| &modules[*name]));
        writeln!(text, "    ({name:?}, {hash:?}),").expect("memory takes text");
    }
    let all = hash(&common, modules.values().flatten());
    writeln!(
        text,
        "];\n/// Hash of every file.\nconst ALL: &str = {all:?};"
    )
    .expect("memory takes text");
    let path = Path::new(&variable("OUT_DIR")).join("fingerprints.rs");
    fs::write(&path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

type Files = Vec<(String, Vec<u8>)>;

/// Every top-level module with its files, names relative to `sources`, sorted.
fn modules(sources: &Path) -> BTreeMap<String, Files> {
    let mut modules = BTreeMap::<String, Files>::new();
    for (name, content) in files(sources) {
        let head = name.split('/').next().expect("a name has a head");
        let module = head.trim_end_matches(".rs").to_owned();
        modules.entry(module).or_default().push((name, content));
    }
    modules
}

/// All files below a folder, sorted by name.
fn files(folder: &Path) -> Files {
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut found = Files::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        let entries =
            fs::read_dir(&next).unwrap_or_else(|error| panic!("{}: {error}", next.display()));
        for entry in entries {
            let path = entry.expect("an entry of a source folder").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let content =
                fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let name = path
                .strip_prefix(folder)
                .expect("a file lies in its folder");
            found.push((name.to_string_lossy().replace('\\', "/"), content));
        }
    }
    found.sort();
    found
}

/// Modules that `start` reaches; all of them where it names something of the crate's root that is none.
fn reach<'a>(modules: &'a BTreeMap<String, Files>, start: &'a str) -> BTreeSet<&'a str> {
    let mut reached = BTreeSet::from([start]);
    let mut open = vec![start];
    while let Some(next) = open.pop() {
        for (file, content) in &modules[next] {
            for name in names(file, &String::from_utf8_lossy(content), modules) {
                match modules.get_key_value(&name) {
                    Some((known, _)) if reached.insert(known) => open.push(known),
                    Some(_) => {}
                    None => return modules.keys().map(String::as_str).collect(),
                }
            }
        }
    }
    reached
}

/// Names of the crate's root in a file: those behind `crate::`, one by one or in braces, and modules behind enough
/// `super::` to reach the root from `file`.
fn names(file: &str, text: &str, modules: &BTreeMap<String, Files>) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for (start, _) in text.match_indices("crate::") {
        let rest = &text[start + "crate::".len()..];
        match rest.strip_prefix('{') {
            Some(list) => names.extend(heads(list)),
            None => names.extend([identifier(rest)]),
        }
    }
    let depth = file.trim_end_matches("/mod.rs").split('/').count();
    let chain = "super::".repeat(depth);
    for (start, _) in text.match_indices(&chain) {
        let name = identifier(text[start + chain.len()..].trim_start_matches("super::"));
        // A module inside the file reaches less far: what it finds there is no module of the root.
        names.extend(Some(name).filter(|name| modules.contains_key(name)));
    }
    names.remove("");
    names
}

/// First names of the elements of a brace list, up to its end.
fn heads(list: &str) -> Vec<String> {
    let mut depth = 0;
    let mut heads = Vec::new();
    let mut fresh = true;
    for (place, character) in list.char_indices() {
        match character {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => fresh = true,
            _ if fresh && !character.is_whitespace() => {
                heads.push(identifier(&list[place..]));
                fresh = false;
            }
            _ => {}
        }
    }
    heads
}

fn identifier(text: &str) -> String {
    text.chars()
        .take_while(|character| character.is_alphanumeric() || *character == '_')
        .collect()
}

/// What all products depend on.
fn common(root: &Path) -> Vec<u8> {
    let mut common = Vec::new();
    // In a registry the format crate is a dependency like others, whose version the lock file has.
    let format = root.join("../format/src");
    if format.is_dir() {
        for (name, content) in files(&format) {
            common.extend(name.into_bytes());
            common.extend(content);
        }
    }
    let lock = [root.join("../Cargo.lock"), root.join("Cargo.lock")];
    if let Some(lock) = lock.iter().find(|lock| lock.is_file()) {
        println!("cargo::rerun-if-changed={}", lock.display());
        common.extend(fs::read(lock).unwrap_or_else(|error| panic!("{}: {error}", lock.display())));
    }
    for name in ["CARGO_PKG_VERSION", "TARGET", "CARGO_CFG_TARGET_FEATURE"] {
        common.extend(std::env::var(name).unwrap_or_default().into_bytes());
    }
    let features = std::env::vars().filter(|(name, _)| name.starts_with("CARGO_FEATURE_"));
    let features: BTreeSet<String> = features.map(|(name, _)| name).collect();
    common.extend(features.into_iter().flat_map(String::into_bytes));
    let version = Command::new(variable("RUSTC")).arg("-vV").output();
    common.extend(version.expect("the compiler names its version").stdout);
    common
}

fn variable(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// 128 bits, by two runs that begin differently. Nobody attacks this hash: it tells versions of one code apart.
fn hash<'a>(common: &[u8], files: impl Iterator<Item = &'a (String, Vec<u8>)> + Clone) -> String {
    let half = |seed: u8| {
        let mut hasher = DefaultHasher::new();
        hasher.write_u8(seed);
        hasher.write(common);
        for (name, content) in files.clone() {
            hasher.write_usize(name.len());
            hasher.write(name.as_bytes());
            hasher.write_usize(content.len());
            hasher.write(content);
        }
        hasher.finish()
    };
    format!("{:016x}{:016x}", half(0), half(1))
}
