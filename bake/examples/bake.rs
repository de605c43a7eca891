//! Bakes a scene inside of another program, and listens to its progress.
//!
//! `cargo run -p cairn-bake --example bake -- scene.gltf scene.cairn [sky.hdr]`

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;

use cairn_bake::{BakeError, Options, Progress, Summary, bake};

/// Prints each stage once, when it begins. A listener is called from many threads.
#[derive(Default)]
struct Stages {
    last: Mutex<String>,
}

impl Progress for Stages {
    fn update(&self, stage: &str, _fraction: f32) {
        let mut last = self
            .last
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        if *last != stage {
            println!("{stage} ...");
            stage.clone_into(&mut last);
        }
    }
}

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: bake SCENE PACKAGE [SKY]");
        return ExitCode::from(2);
    };
    match run(input, output, arguments.next()) {
        Ok(summary) => {
            print(&summary);
            ExitCode::SUCCESS
        }
        // Errors name file, place and remedy; the output is then as it was.
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn run(input: PathBuf, output: PathBuf, sky: Option<PathBuf>) -> Result<Summary, BakeError> {
    let mut options = Options::new(input, output);
    options.environment = sky;
    bake(&options, &Stages::default())
}

fn print(summary: &Summary) {
    for diagnostic in &summary.diagnostics {
        println!("{diagnostic}");
    }
    println!(
        "{} triangles, {} bytes",
        summary.triangles, summary.package_bytes
    );
    for row in &summary.report {
        println!("{} {}: {} {}", row.stage, row.item, row.error, row.metric);
    }
}
