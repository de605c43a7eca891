//! Times `Package::open` and `verify` against the bulk size.
//!
//! `cargo bench -p cairn-format -- FILE.cairn...` measures files instead of synthetic packages.

use std::path::Path;
use std::time::Instant;

use bytemuck::Zeroable;
use cairn_format::{Package, SectionKind, Vertex, Writer, scene::Scene};

fn main() {
    let files: Vec<String> = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with("--"))
        .collect();
    if files.is_empty() {
        let folder = tempfile::tempdir().expect("a folder");
        for exponent in [10, 15, 20, 22] {
            let path = folder.path().join(format!("{exponent}.cairn"));
            let vertices = vec![Vertex::zeroed(); 1 << exponent];
            let mut writer = Writer::new();
            writer.records(SectionKind::Vertices, &vertices);
            std::fs::write(
                &path,
                writer.to_vec(&Scene::empty("bench"), "0").expect("bytes"),
            )
            .expect("a file");
            measure(&path);
        }
    }
    files.iter().for_each(|file| measure(Path::new(file)));
}

fn measure(path: &Path) {
    let mut times: Vec<f64> = (0..101)
        .map(|_| {
            let start = Instant::now();
            let package = Package::open(path).expect("a good package");
            std::hint::black_box(package.scene());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let package = Package::open(path).expect("a good package");
    let start = Instant::now();
    package.verify().expect("a sound package");
    let verify = start.elapsed().as_secs_f64() * 1e3;
    let megabytes = package.header().file_length as f64 / 1e6;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    println!(
        "{name}: {megabytes:.2} MB, open p50 {:.3} ms p95 {:.3} ms, verify {verify:.1} ms",
        times[50], times[95]
    );
}
