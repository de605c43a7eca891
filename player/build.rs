//! Embeds the commit that the player is built from: `CAIRN_COMMIT`, or what git says, or `unknown`.

use std::process::Command;

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let text = text.trim();
    (output.status.success() && !text.is_empty()).then(|| text.to_owned())
}

fn main() {
    println!("cargo::rerun-if-env-changed=CAIRN_COMMIT");
    println!("cargo::rerun-if-changed=build.rs");
    // The log of HEAD changes with every commit and every checkout.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"])
        && std::path::Path::new(&log).exists()
    {
        println!("cargo::rerun-if-changed={log}");
    }
    let named = std::env::var("CAIRN_COMMIT")
        .ok()
        .filter(|name| !name.is_empty());
    let commit = named.or_else(|| git(&["describe", "--always", "--tags", "--abbrev=12"]));
    println!(
        "cargo::rustc-env=CAIRN_COMMIT={}",
        commit.as_deref().unwrap_or("unknown")
    );
}
