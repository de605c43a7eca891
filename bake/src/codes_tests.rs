//! Tests of the table of codes: sorted, used, documented.

use std::path::{Path, PathBuf};

use super::*;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn codes_are_sorted_and_found() {
    assert!(CODES.is_sorted_by(|a, b| a.name < b.name));
    for code in CODES {
        assert_eq!(find(code.name), Some(code));
        for text in [code.why, code.fix] {
            assert!(text.ends_with('.') && !text.contains('\n'), "{}", code.name);
        }
    }
    assert_eq!(find("no-such-code"), None);
}

fn is_source(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.ends_with(".rs")
        && name != "codes.rs"
        && !name.ends_with("tests.rs")
        && name != "testing.rs"
}

fn sources(folder: &Path, found: &mut String) {
    let mut entries: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder of sources")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, found);
        } else if is_source(&path) {
            let text = std::fs::read_to_string(&path).expect("a source file");
            *found += text
                .split("#[cfg(test)]\nmod tests {")
                .next()
                .unwrap_or_default();
        }
    }
}

/// Sources without their tests.
fn all_sources() -> String {
    let mut text = String::new();
    sources(&root().join("bake/src"), &mut text);
    text
}

#[test]
fn every_code_is_used() {
    let text = all_sources();
    let unused: Vec<_> = CODES
        .iter()
        .filter(|code| !text.contains(&format!("\"{}\"", code.name)))
        .map(|code| code.name)
        .collect();
    assert!(unused.is_empty(), "{unused:?}");
}

/// The first or second argument of a call, where it is a literal that looks like a code.
fn code_of_call(arguments: &str) -> Option<&str> {
    let literal = |text: &str| text.trim_start().starts_with('"');
    let second = arguments.split_once(',').map(|(_, second)| second);
    let rest = [Some(arguments), second]
        .into_iter()
        .flatten()
        .find(|text| literal(text))?;
    let (code, behind) = rest.trim_start()[1..].split_once('"')?;
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    (!code.is_empty() && code.chars().all(plain) && behind.starts_with(',')).then_some(code)
}

#[test]
fn every_message_has_a_known_code() {
    let text = all_sources();
    let mut calls = 0;
    for callee in [
        "warning(",
        "error(",
        "input(",
        "warn(",
        "warn_group(",
        "refuse(",
        "fault(",
    ] {
        for (at, _) in text.match_indices(callee) {
            let Some(code) = code_of_call(&text[at + callee.len()..]) else {
                continue;
            };
            calls += 1;
            assert!(find(code).is_some(), "`{code}` is not in the table");
        }
    }
    assert!(calls > 60, "{calls}");
}

#[test]
fn the_documentation_is_this_table() {
    let path = root().join("docs/diagnostics.md");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, markdown()).expect("docs/diagnostics.md is written");
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        written == markdown(),
        "docs/diagnostics.md is out of date: run this test with UPDATE_DOCS=1"
    );
}
