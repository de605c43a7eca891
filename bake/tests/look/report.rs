//! `report` writes one page that needs nothing beside it, and that a browser shows without complaint.

use std::path::Path;
use std::process::Command;

use super::{asset, json, materials, path, run, text};

/// The package of many materials, what its bake said, and a page about both.
fn page() -> (tempfile::TempDir, std::path::PathBuf) {
    let (folder, package) = materials();
    let summary = folder.path().join("bake.json");
    let scene = asset("materials/materials.gltf");
    let output = folder.path().join("again.cairn");
    let said = run(&[path(&scene), "-o", path(&output), "--json"]);
    std::fs::write(&summary, &said.stdout).expect("a file");
    let page = folder.path().join("report with spaces.html");
    let done = run(&[
        "report",
        path(&package),
        "-o",
        path(&page),
        "--summary",
        path(&summary),
        "--no-picture",
    ]);
    assert!(
        done.status.success() && done.stdout.is_empty(),
        "{}",
        text(&done.stderr)
    );
    (folder, page)
}

#[test]
fn the_page_stands_alone() {
    let (_folder, page) = page();
    let html = std::fs::read_to_string(page).expect("the page");
    for foreign in ["<script", "http:", "https:", "url(", "@import", "<iframe"] {
        assert!(!html.contains(foreign), "{foreign}");
    }
    for source in html.split("src=\"").skip(1) {
        assert!(
            source.starts_with("data:image/png;base64,"),
            "{}",
            &source[..40.min(source.len())]
        );
    }
    for part in [
        "name=\"viewport\"",
        "prefers-color-scheme:dark",
        "class=\"map\"",
        "<strong>leaf</strong>",
        "<h3>psnr dB <span",
        "<h2>Time</h2>",
        "geometry",
        "alpha coverage",
        "materials.gltf",
    ] {
        assert!(html.contains(part), "{part}");
    }
    // All textures have a picture.
    assert_eq!(
        html.matches("data:image/png").count(),
        4,
        "leaf, studs, checker twice"
    );
}

#[test]
fn what_is_missing_is_said() {
    let (folder, package) = materials();
    let page = folder.path().join("report.html");
    let player = folder.path().join("no-player");
    let done = run(&[
        "report",
        path(&package),
        "-o",
        path(&page),
        "--player",
        path(&player),
        "--json",
    ]);
    let said = json(&done);
    assert!(done.status.success() && said["picture"] == false, "{said}");
    assert!(
        said["no_picture"]
            .as_str()
            .is_some_and(|why| why.contains("no-player")),
        "{said}"
    );
    let html = std::fs::read_to_string(&page).expect("the page");
    assert!(html.contains("No picture of the scene") && html.contains("--summary bake.json"));

    let done = run(&[
        "report",
        path(&package),
        "-o",
        path(&page),
        "--no-picture",
        "--summary",
        path(&package),
    ]);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("not the summary of a bake"),
        "{}",
        text(&done.stderr)
    );
    let done = run(&[
        "report",
        path(&package),
        "-o",
        path(&package),
        "--no-picture",
    ]);
    assert_eq!(done.status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn the_player_is_asked_for_a_picture() {
    use std::os::unix::fs::PermissionsExt;
    let (folder, package) = materials();
    let player = folder.path().join("player");
    let drawn = asset("materials/textures/checker.png");
    // In place of the player: copies a picture to where `--out` says.
    let script = format!(
        "#!/bin/sh\nwhile [ \"$1\" != --out ]; do shift; done\ncp '{}' \"$2\"\n",
        path(&drawn)
    );
    std::fs::write(&player, script).expect("a script");
    std::fs::set_permissions(&player, std::fs::Permissions::from_mode(0o755)).expect("a program");
    let page = folder.path().join("report.html");
    let said = json(&run(&[
        "report",
        path(&package),
        "-o",
        path(&page),
        "--player",
        path(&player),
        "--json",
    ]));
    assert_eq!(said["picture"], true, "{said}");
    let html = std::fs::read_to_string(&page).expect("the page");
    assert!(html.contains("Drawn by cairn-player"));
}

/// A browser of the Chromium family; says loudly where there is none.
fn chromium() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|name| {
        let version = Command::new(name).arg("--version").output();
        version.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        eprintln!("SKIPPED: the report page is not opened: no chromium");
    }
    found
}

fn shown(browser: &str, page: &Path, width: u32, picture: &Path) -> (String, image::RgbaImage) {
    let profile = tempfile::tempdir().expect("a folder");
    let done = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--enable-logging=stderr",
        ])
        .arg(format!("--user-data-dir={}", path(profile.path())))
        .arg(format!("--window-size={width},1600"))
        .arg(format!("--screenshot={}", path(picture)))
        .arg(format!("file://{}", path(page).replace(' ', "%20")))
        .output()
        .expect("the browser runs");
    let picture = image::open(picture).expect("a screenshot").to_rgba8();
    (text(&done.stderr), picture)
}

#[test]
fn a_browser_shows_the_page() {
    let Some(browser) = chromium() else {
        return;
    };
    let (folder, page) = page();
    for width in [500, 1280] {
        let (log, picture) = shown(browser, &page, width, &folder.path().join("page.png"));
        assert!(!log.contains(":CONSOLE"), "{log}");
        assert_eq!(picture.width(), width);
        let colors: std::collections::BTreeSet<[u8; 4]> =
            picture.pixels().map(|pixel| pixel.0).collect();
        assert!(
            colors.len() > 500,
            "{} colours at {width}: not a page of pictures",
            colors.len()
        );
    }
}
