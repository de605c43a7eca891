//! The incremental bake as a user has it: equal bytes, reasons, damage, and processes that die or compete.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, SystemTime};

use serde_json::Value;

/// A copy of our scene of materials with a tiny sky, a cache, and outputs.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self {
            folder: tempfile::tempdir().expect("a folder"),
        };
        let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/materials");
        copy(&assets, &bench.path("scene"));
        let mut sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9 +X 16\n".to_vec();
        for texel in 0..144u8 {
            sky.extend([100, 90, texel, if texel == 20 { 140 } else { 128 }]);
        }
        std::fs::write(bench.path("sky.hdr"), sky).expect("written");
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, output: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cairn-bake"));
        command
            .arg(self.path("scene/materials.gltf"))
            .arg("-o")
            .arg(self.path(output))
            .args(["--texture-quality", "fast", "--threads", "2"])
            .args(more)
            .env("CAIRN_CACHE", self.path("cache"));
        command
    }

    /// Bakes without a sky.
    fn bake(&self, output: &str, more: &[&str]) -> Output {
        self.command(output, more).output().expect("it runs")
    }

    /// Bakes under the sky.
    fn bake_lit(&self, output: &str, more: &[&str]) -> Output {
        self.command(output, more)
            .args(["--ibl-quality", "draft", "--env"])
            .arg(self.path("sky.hdr"))
            .output()
            .expect("it runs")
    }

    fn bytes(&self, output: &str) -> Vec<u8> {
        std::fs::read(self.path(output)).expect("the package")
    }

    /// Numbers of sound and of damaged entries.
    fn check(&self) -> [u64; 2] {
        let done = Command::new(env!("CARGO_BIN_EXE_cairn-bake"))
            .args(["cache", "check", "--json", "--cache"])
            .arg(self.path("cache"))
            .output()
            .expect("it runs");
        let json = json(&done);
        ["sound", "damaged"].map(|name| json[name].as_u64().expect("a count"))
    }

    /// Temporary files, wherever.
    fn leftovers(&self) -> Vec<PathBuf> {
        let folders = [self.path(""), self.path("cache/temporary")];
        let entries = folders
            .iter()
            .filter_map(|folder| std::fs::read_dir(folder).ok());
        entries
            .flatten()
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| path.extension().is_some_and(|ending| ending == "tmp"))
            .collect()
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &target);
        } else {
            std::fs::copy(&path, &target).expect("a copy");
        }
    }
}

fn json(done: &Output) -> Value {
    assert!(done.status.success(), "{}", text(&done.stderr));
    serde_json::from_slice(&done.stdout).expect("one JSON object")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// What is said of the products: errors, sizes, warnings, and no times.
fn told(json: &Value) -> (Vec<Value>, Value, Value) {
    let mut rows = json["report"].as_array().expect("rows").clone();
    for row in &mut rows {
        row["seconds"] = Value::Null;
        row["throughput"] = Value::Null;
    }
    (rows, json["diagnostics"].clone(), json["sections"].clone())
}

/// Names of the products that were made anew, with the reason.
fn missed(json: &Value) -> Vec<(String, String)> {
    let products = json["cache"]["products"].as_array().expect("products");
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    products
        .iter()
        .filter(|product| product["hit"] == false)
        .map(|product| (text(&product["name"]), text(&product["why"])))
        .collect()
}

#[test]
fn cold_warm_and_idle_bakes_agree_in_all_they_write_and_say() {
    let bench = Bench::new();
    let without = json(&bench.bake_lit("cold.cairn", &["--json", "--cache", "off"]));
    assert!(without["cache"].is_null() && !bench.path("cache").exists());
    let filling = json(&bench.bake_lit("filling.cairn", &["--json"]));
    // Nothing was there; some meshes are equal.
    assert!(missed(&filling).len() > 5, "{filling}");
    let warm = json(&bench.bake_lit("warm.cairn", &["--json"]));
    assert_eq!(missed(&warm), []);
    assert_eq!(warm["cache"]["unchanged"], false);
    let written = std::fs::metadata(bench.path("warm.cairn")).and_then(|file| file.modified());
    let idle = json(&bench.bake_lit("warm.cairn", &["--json"]));
    assert_eq!(idle["cache"]["unchanged"], true);
    let after = std::fs::metadata(bench.path("warm.cairn")).and_then(|file| file.modified());
    assert_eq!(written.expect("a time"), after.expect("a time"));

    let cold = bench.bytes("cold.cairn");
    assert!(bench.bytes("filling.cairn") == cold && bench.bytes("warm.cairn") == cold);
    let (rows, warnings, _) = told(&without);
    assert!(rows.len() > 10 && warnings.as_array().is_some_and(|list| !list.is_empty()));
    for other in [&filling, &warm, &idle] {
        assert_eq!(told(other), told(&without));
    }
    // A damaged output is no longer what was written, and one that is gone even less.
    let mut damaged = cold.clone();
    *damaged.last_mut().expect("a byte") ^= 1;
    std::fs::write(bench.path("warm.cairn"), damaged).expect("written");
    let repaired = json(&bench.bake_lit("warm.cairn", &["--json"]));
    assert_eq!(repaired["cache"]["unchanged"], false);
    assert!(bench.bytes("warm.cairn") == cold && missed(&repaired).is_empty());
    std::fs::remove_file(bench.path("warm.cairn")).expect("removed");
    bench.bake_lit("warm.cairn", &[]);
    assert!(bench.bytes("warm.cairn") == cold);
}

/// Replaces a texture by that of another scene; returns the name of the image.
fn change_a_texture(bench: &Bench) -> &'static str {
    let other = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hall/textures/leaf.png");
    std::fs::copy(other, bench.path("scene/textures/leaf.png")).expect("copied");
    "leaf"
}

#[test]
fn a_touched_image_is_encoded_again_and_nothing_else() {
    let bench = Bench::new();
    bench.bake("out.cairn", &[]);
    // A new time alone changes nothing.
    let scene = std::fs::File::options()
        .write(true)
        .open(bench.path("scene/materials.gltf"))
        .expect("the scene");
    scene.set_modified(SystemTime::now()).expect("a time");
    let touched = json(&bench.bake("out.cairn", &["--json"]));
    assert_eq!(touched["cache"]["unchanged"], true);

    let name = change_a_texture(&bench);
    let changed = json(&bench.bake("out.cairn", &["--json"]));
    let made: Vec<&Value> = changed["cache"]["products"]
        .as_array()
        .expect("products")
        .iter()
        .filter(|product| product["hit"] == false)
        .collect();
    // One is encoded; that its channels vary is looked up anew too.
    let encoded = made.iter().filter(|product| product["kind"] == "texture");
    assert_eq!(encoded.count(), 1, "{made:?}");
    for product in &made {
        let product_name = product["name"].as_str().expect("a name");
        let facts = product["kind"] == "texture" || product["kind"] == "image-facts";
        assert!(facts && product_name.starts_with(name), "{made:?}");
        assert_eq!(product["why"], "image changed");
    }
    bench.bake("cold.cairn", &["--cache", "off"]);
    assert!(bench.bytes("out.cairn") == bench.bytes("cold.cairn"));

    bench.bake_lit("out.cairn", &[]);
    let done = bench.bake_lit("out.cairn", &["--explain", "--sun", "keep"]);
    let said = text(&done.stdout);
    let line = said
        .lines()
        .find(|line| line.starts_with("miss environment"));
    let line = line.unwrap_or_else(|| panic!("{said}"));
    assert!(
        line.contains("settings changed: sun Auto -> Keep"),
        "{line}"
    );
    assert_eq!(said.matches("\nmiss ").count(), 1, "{said}");
    let done = bench.bake_lit("out.cairn", &["--explain", "--sun", "keep"]);
    assert!(
        text(&done.stdout).contains("left as it is"),
        "{}",
        text(&done.stdout)
    );
}

#[test]
fn two_bakes_from_nothing_are_equal_and_shown_to_be() {
    let bench = Bench::new();
    let verify = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_cairn-bake"))
            .args([
                "verify",
                "--twice",
                "--threads",
                "3",
                "--texture-quality",
                "fast",
            ])
            .args(more)
            .arg(bench.path("scene/materials.gltf"))
            .env("CAIRN_CACHE", bench.path("cache"))
            .output()
            .expect("it runs")
    };
    let verdict = json(&verify(&["--json"]));
    assert_eq!(verdict["equal"], true);
    assert_eq!(
        [
            &verdict["runs"][0]["threads"],
            &verdict["runs"][1]["threads"]
        ],
        [1, 3]
    );
    // The hashes are those of the package, as `-v` prints them.
    let printed = text(&bench.bake("out.cairn", &["-v"]).stdout);
    let sections = verdict["sections"].as_array().expect("sections");
    assert!(sections.len() > 8);
    for section in sections {
        let hash = section["hashes"][1].as_str().expect("a hash");
        assert!(printed.contains(hash), "{section} in {printed}");
    }
    let content = verdict["runs"][0]["content_hash"].as_str().expect("a hash");
    assert!(printed.contains(content), "{content} in {printed}");
    let said = text(&verify(&[]).stdout);
    assert!(said.ends_with("\nequal\n"), "{said}");
    // Settings of a bake say nothing of a package.
    let done = Command::new(env!("CARGO_BIN_EXE_cairn-bake"))
        .args(["verify", "--sun", "keep"])
        .arg(bench.path("out.cairn"))
        .output()
        .expect("it runs");
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
}

#[test]
fn errors_are_the_same_with_a_full_cache() {
    let bench = Bench::new();
    bench.bake("out.cairn", &[]);
    let before = bench.bytes("out.cairn");
    let textures = bench.path("scene/textures");
    let image = std::fs::read_dir(textures).expect("textures").next();
    let image = image.expect("a texture").expect("an entry").path();
    let whole = std::fs::read(&image).expect("a texture");
    std::fs::write(&image, &whole[..whole.len() / 2]).expect("cut");
    let cold = bench.bake("out.cairn", &["--cache", "off"]);
    let warm = bench.bake("out.cairn", &[]);
    assert_eq!((cold.status.code(), warm.status.code()), (Some(2), Some(2)));
    assert_eq!(text(&warm.stderr), text(&cold.stderr));
    // What a larger limit let pass is refused by a smaller one.
    std::fs::write(&image, &whole).expect("whole again");
    let limit = ["--limit-pixels", "100"];
    let warm = bench.bake("out.cairn", &limit);
    let cold = bench.bake("out.cairn", &[&limit[..], &["--cache", "off"]].concat());
    assert_eq!((cold.status.code(), warm.status.code()), (Some(2), Some(2)));
    assert_eq!(text(&warm.stderr), text(&cold.stderr));
    assert!(bench.bytes("out.cairn") == before);
}

#[test]
fn bakes_at_once_share_a_cache() {
    let bench = Bench::new();
    let names = ["a.cairn", "b.cairn", "c.cairn", "a.cairn"];
    let running: Vec<_> = names
        .iter()
        .map(|name| bench.command(name, &["--quiet"]).spawn().expect("it runs"))
        .collect();
    for mut bake in running {
        assert!(bake.wait().expect("it ends").success());
    }
    let a = bench.bytes("a.cairn");
    assert!(bench.bytes("b.cairn") == a && bench.bytes("c.cairn") == a);
    let [sound, damaged] = bench.check();
    assert!(sound > 3 && damaged == 0);
    assert!(bench.leftovers().is_empty());
    assert!(missed(&json(&bench.bake("d.cairn", &["--json"]))).is_empty());
}

/// Delays that differ from round to round and not from run to run.
fn delay(round: u64, most: Duration) -> Duration {
    let share = round.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    most * (share as u32) / (1 << 24)
}

#[cfg(unix)]
#[test]
fn killed_bakes_leave_nothing_half_written() {
    let bench = Bench::new();
    let start = std::time::Instant::now();
    assert!(
        bench
            .bake("whole.cairn", &["--cache", "off"])
            .status
            .success()
    );
    let most = start.elapsed() * 5 / 4;
    let whole = bench.bytes("whole.cairn");
    let old = b"an older package".to_vec();
    let (mut untouched, mut finished) = (0, 0);
    for round in 0..20 {
        if round % 2 == 0 {
            // A cold cache every other round; in between it is as the killed left it.
            let _ = std::fs::remove_dir_all(bench.path("cache"));
        }
        std::fs::write(bench.path("out.cairn"), &old).expect("written");
        let mut bake = bench
            .command("out.cairn", &["--quiet"])
            .spawn()
            .expect("it runs");
        std::thread::sleep(delay(round, most));
        bake.kill().expect("killed");
        bake.wait().expect("it ends");
        let found = bench.bytes("out.cairn");
        assert!(
            found == old || found == whole,
            "round {round}: {} bytes",
            found.len()
        );
        *(if found == old {
            &mut untouched
        } else {
            &mut finished
        }) += 1;
        assert_eq!(bench.check()[1], 0, "round {round}: a damaged entry");
    }
    assert!(untouched > 0 && finished > 0, "{untouched} {finished}");
    // The next bake removes what the dead left, once it is old enough to be nobody's.
    for path in bench.leftovers() {
        let file = std::fs::File::options()
            .write(true)
            .open(path)
            .expect("a file");
        file.set_modified(SystemTime::now() - Duration::from_secs(60))
            .expect("a time");
    }
    std::fs::write(bench.path("out.cairn"), &old).expect("written");
    assert!(bench.bake("out.cairn", &[]).status.success());
    assert!(bench.bytes("out.cairn") == whole);
    assert!(bench.leftovers().is_empty(), "{:?}", bench.leftovers());
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_says_so_and_cleans_up() {
    let bench = Bench::new();
    let start = std::time::Instant::now();
    assert!(
        bench
            .bake("whole.cairn", &["--cache", "off"])
            .status
            .success()
    );
    let most = start.elapsed();
    let whole = bench.bytes("whole.cairn");
    let mut interrupted = 0;
    for (round, (signal, code)) in [
        ("-INT", 130),
        ("-TERM", 143),
        ("-INT", 130),
        ("-HUP", 129),
        ("-INT", 130),
    ]
    .into_iter()
    .enumerate()
    {
        let _ = std::fs::remove_dir_all(bench.path("cache"));
        let _ = std::fs::remove_file(bench.path("out.cairn"));
        let mut bake = bench
            .command("out.cairn", &["--quiet"])
            .spawn()
            .expect("it runs");
        // The handler must be there: the cache is opened after it.
        std::thread::sleep(most / 4 + most * round as u32 / 10);
        let id = bake.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status();
        assert!(sent.expect("`kill` runs").success());
        let status = bake.wait().expect("it ends");
        if status.success() {
            // It was over already.
            continue;
        }
        assert_eq!(status.code(), Some(code), "{signal}");
        // The signal may come between the last rename and the end.
        let found = std::fs::read(bench.path("out.cairn"));
        assert!(found.is_err() || found.is_ok_and(|bytes| bytes == whole));
        assert!(bench.leftovers().is_empty(), "{:?}", bench.leftovers());
        interrupted += 1;
    }
    assert!(interrupted > 1, "{interrupted}");
}
