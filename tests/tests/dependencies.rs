//! Tests what the crates depend on.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(name: &str) -> String {
    let path = root().join(name);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Names in `[workspace.dependencies]` other than the workspace's own crates.
///
/// Relies on the house format: every dependency starts a line, and what follows of it on
/// further lines is indented or a closing bracket.
fn declared_dependencies() -> BTreeSet<String> {
    read("Cargo.toml")
        .lines()
        .skip_while(|line| *line != "[workspace.dependencies]")
        .skip(1)
        .take_while(|line| !line.starts_with('['))
        .filter(|line| line.starts_with(|c: char| c.is_ascii_alphabetic()))
        .filter_map(|line| line.split([' ', '=', '.']).next())
        .filter(|name| !name.starts_with("cairn-"))
        .map(str::to_owned)
        .collect()
}

/// Reasons in `deny.toml` by crate, from lines `# dependency: <crate>: <reason>`.
fn reasons() -> BTreeMap<String, String> {
    let mut reasons = BTreeMap::new();
    for line in read("deny.toml").lines() {
        if let Some(rest) = line.strip_prefix("# dependency: ") {
            let (name, reason) = rest.split_once(": ").expect("a crate, a colon, a reason");
            let previous = reasons.insert(name.to_owned(), reason.trim().to_owned());
            assert_eq!(previous, None, "deny.toml gives two reasons for {name}");
        }
    }
    reasons
}

/// The triple that the compiler builds for, so that `cargo metadata` asks for no crate that
/// only other platforms need: those may not have been downloaded.
fn host() -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("-vV").output().expect("rustc runs");
    let text = String::from_utf8(output.stdout).expect("rustc prints UTF-8");
    text.lines()
        .find_map(|line| line.strip_prefix("host: "))
        .expect("rustc names its host")
        .to_owned()
}

/// The workspace's dependency graph as cargo resolves it.
struct Graph {
    metadata: Value,
}

impl Graph {
    fn load() -> Self {
        let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            .args(["metadata", "--offline", "--locked", "--format-version", "1"])
            .args(["--filter-platform", &host()])
            .current_dir(root())
            .output()
            .expect("cargo runs");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "cargo metadata: {errors}");
        let metadata = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
        Self { metadata }
    }

    fn packages(&self) -> &Vec<Value> {
        self.metadata["packages"].as_array().expect("packages")
    }

    /// Package names by package id.
    fn names(&self) -> BTreeMap<&str, &str> {
        self.packages()
            .iter()
            .filter_map(|package| Some((package["id"].as_str()?, package["name"].as_str()?)))
            .collect()
    }

    /// Ids of the packages that `id` links: its normal dependencies, not those of its build
    /// script or its tests.
    fn links(&self) -> BTreeMap<&str, Vec<&str>> {
        let nodes = self.metadata["resolve"]["nodes"].as_array().expect("nodes");
        let is_normal = |dependency: &&Value| {
            let kinds = dependency["dep_kinds"].as_array().expect("kinds");
            kinds.iter().any(|kind| kind["kind"].is_null())
        };
        nodes
            .iter()
            .map(|node| {
                let dependencies = node["deps"].as_array().expect("deps").iter();
                let normal = dependencies.filter(is_normal);
                let ids = normal.filter_map(|dependency| dependency["pkg"].as_str());
                (node["id"].as_str().expect("id"), ids.collect())
            })
            .collect()
    }

    /// Names of all packages linked into workspace member `name`, itself included.
    fn linked_into(&self, name: &str) -> BTreeSet<&str> {
        let names = self.names();
        let links = self.links();
        let members = self.metadata["workspace_members"]
            .as_array()
            .expect("members");
        let start = members
            .iter()
            .filter_map(Value::as_str)
            .find(|id| names[id] == name);
        let mut open = vec![start.unwrap_or_else(|| panic!("no member {name}"))];
        let mut seen = BTreeSet::new();
        while let Some(id) = open.pop() {
            if seen.insert(id) {
                open.extend(&links[id]);
            }
        }
        seen.into_iter().map(|id| names[id]).collect()
    }
}

fn assert_links_none(member: &str, forbidden: &[&str]) {
    let graph = Graph::load();
    let linked = graph.linked_into(member);
    let found: Vec<_> = forbidden
        .iter()
        .filter(|name| linked.contains(*name))
        .collect();
    assert!(found.is_empty(), "{member} depends on {found:?}");
}

const VULKAN: &[&str] = &["ash", "ash-window", "gpu-allocator", "vulkano", "wgpu"];
const GLTF: &[&str] = &["gltf", "gltf-json"];
const CODECS: &[&str] = &["image", "exr", "zune-jpeg", "image-webp", "bcdec_rs"];
const SHADER_COMPILERS: &[&str] = &["glslang", "glslang-sys", "shaderc", "shaderc-sys", "naga"];

#[test]
fn every_dependency_has_a_reason() {
    let declared = declared_dependencies();
    assert!(
        declared.contains("glam") && declared.contains("winit"),
        "{declared:?}"
    );
    let reasons = reasons();
    for name in &declared {
        let reason = reasons
            .get(name)
            .unwrap_or_else(|| panic!("deny.toml has no `# dependency: {name}: reason`"));
        assert!(!reason.is_empty(), "the reason for {name} is empty");
    }
    for name in reasons.keys() {
        assert!(
            declared.contains(name),
            "deny.toml gives a reason for {name}, no dependency"
        );
    }
}

#[test]
fn every_declared_dependency_is_used() {
    let graph = Graph::load();
    let used: BTreeSet<_> = graph
        .packages()
        .iter()
        .filter(|package| package["source"].is_null())
        .flat_map(|member| member["dependencies"].as_array().expect("dependencies"))
        .filter_map(|dependency| dependency["name"].as_str())
        .collect();
    for name in declared_dependencies() {
        assert!(used.contains(name.as_str()), "no crate uses {name}");
    }
}

#[test]
fn the_graph_sees_through_other_crates() {
    let graph = Graph::load();
    let linked = graph.linked_into("cairn-player");
    assert!(linked.contains("blake3"), "through cairn-format");
    assert!(!linked.contains("proptest"), "only tests use it");
}

#[test]
fn format_knows_no_vulkan_and_no_gltf() {
    assert_links_none("cairn-format", &[VULKAN, GLTF, CODECS].concat());
}

#[test]
fn bake_knows_no_vulkan() {
    assert_links_none("cairn-bake", VULKAN);
}

#[test]
fn player_decodes_no_source_format_and_compiles_no_shader() {
    assert_links_none("cairn-player", &[GLTF, CODECS, SHADER_COMPILERS].concat());
}

/// Folders that hold no source: version control, build results, other people's files.
const SKIPPED_FOLDERS: &[&str] = &[".git", ".gl", ".dev", "target", "shared", "current"];

fn text_files(folder: &Path, files: &mut Vec<(PathBuf, String)>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries {
        let entry = entry.expect("an entry");
        let kind = entry.file_type().expect("a file type");
        if kind.is_dir() {
            if !SKIPPED_FOLDERS
                .iter()
                .any(|name| entry.file_name() == *name)
            {
                text_files(&entry.path(), files);
            }
        } else if kind.is_file()
            && let Ok(text) = fs::read_to_string(entry.path())
        {
            files.push((entry.path(), text));
        }
    }
}

/// Package hosts that `text` names. They are put together here from their labels, so that
/// this file names none.
fn package_hosts(text: &str) -> Vec<String> {
    let hosts: [&[&str]; 12] = [
        &["crates", "io"],
        &["deb", "debian", "org"],
        &["security", "debian", "org"],
        &["snapshot", "debian", "org"],
        &["archive", "ubuntu", "com"],
        &["ports", "ubuntu", "com"],
        &["security", "ubuntu", "com"],
        &["pypi", "org"],
        &["files", "pythonhosted", "org"],
        &["sh", "rustup", "rs"],
        &["static", "rust-lang", "org"],
        &["registry", "npmjs", "org"],
    ];
    // Cargo.lock calls the default registry by this name, from which nothing is downloaded.
    let registry = ["rust-lang/crates", "io-index"].join(".");
    let text = text.replace(&registry, "").to_ascii_lowercase();
    let hosts = hosts.iter().map(|labels| labels.join("."));
    hosts.filter(|host| text.contains(host)).collect()
}

#[test]
fn a_named_package_host_is_found() {
    let host = ["deb", "debian", "org"].join(".");
    assert_eq!(
        package_hosts(&format!("URIs: http://{host}/debian")),
        [host]
    );
    let lock = ["https://github.com/rust-lang/crates", "io-index"].join(".");
    assert!(package_hosts(&lock).is_empty());
}

#[test]
fn no_file_names_a_package_host() {
    let mut files = Vec::new();
    text_files(&root(), &mut files);
    assert!(files.iter().any(|(path, _)| path.ends_with("run")));
    for (path, text) in &files {
        let hosts = package_hosts(text);
        assert!(hosts.is_empty(), "{} names {hosts:?}", path.display());
    }
}
