//! Tests that every test which `docs/w-list.md` names exists.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Names of all test functions in Rust files below a folder.
fn collect(folder: &Path, names: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).expect("a folder of the repository") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, names);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).expect("a source file");
            for item in text.split("#[test]").skip(1) {
                let name = item
                    .split_once("fn ")
                    .and_then(|(_, rest)| rest.split_once('('));
                names.extend(name.map(|(name, _)| name.to_owned()));
            }
        }
    }
}

#[test]
fn every_named_test_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut names = BTreeSet::new();
    for folder in ["bake", "format", "player", "tests"] {
        collect(&root.join(folder), &mut names);
    }
    let list = fs::read_to_string(root.join("docs/w-list.md")).expect("the list");
    let rows: Vec<&str> = list
        .lines()
        .filter(|line| line.starts_with("| W-"))
        .collect();
    assert!(rows.len() >= 40, "{} rows", rows.len());
    for row in rows {
        let cell = row
            .trim_end_matches(" |")
            .rsplit(" | ")
            .next()
            .expect("a cell");
        let named: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty() || cell.contains("no test"), "{row}");
        for name in named {
            assert!(names.contains(name), "no test is called {name}: {row}");
        }
    }
}
