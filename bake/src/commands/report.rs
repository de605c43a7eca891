//! Writes one page about a package: its picture, sizes, times, errors, textures, environment, notes.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::{SUCCESS, print_json};
use crate::diagnostic::{BakeError, Result};
use crate::look::{self, Extras, origin, refused};
use crate::report::Summary;
use crate::write;

/// `cairn-bake report PACKAGE -o report.html`.
#[derive(clap::Args, Debug)]
pub struct Report {
    /// The package.
    path: PathBuf,
    /// The page to write.
    #[arg(long, short, value_name = "REPORT.html")]
    output: PathBuf,
    /// What the bake printed with --json: its times and diagnostics, which no package holds.
    #[arg(long, value_name = "BAKE.json")]
    summary: Option<PathBuf>,
    /// The program that draws the scene; by default cairn-player beside this program, or in the path.
    #[arg(long, value_name = "FILE")]
    player: Option<PathBuf>,
    /// Leave the picture of the scene out.
    #[arg(long, conflicts_with = "player")]
    no_picture: bool,
    /// Print what was written as one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// Longest time that the player gets.
const PATIENCE: Duration = Duration::from_secs(120);

impl Report {
    pub(super) fn run(&self) -> Result<u8> {
        let package = look::open(&self.path)?;
        package
            .verify()
            .map_err(|error| refused(&self.path, error))?;
        for input in [Some(&self.path), self.summary.as_ref()]
            .into_iter()
            .flatten()
        {
            if self
                .output
                .canonicalize()
                .is_ok_and(|output| Some(output) == input.canonicalize().ok())
            {
                let what = "the page would overwrite this input; choose another -o";
                return Err(BakeError::input("output-is-input", &origin(input), what));
            }
        }
        let extras = Extras {
            summary: self.summary.as_deref().map(summary).transpose()?,
            picture: if self.no_picture {
                Ok(Vec::new())
            } else {
                self.picture()
            },
        };
        let page = look::page(&package, &extras).map_err(|error| refused(&self.path, error))?;
        write::bytes(&self.output, page.as_bytes())?;
        if self.json {
            print_json(&serde_json::json!({
                "output": self.output.display().to_string(),
                "bytes": page.len(),
                "picture": extras.picture.as_ref().is_ok_and(|png| !png.is_empty()),
                "no_picture": extras.picture.as_ref().err(),
            }))?;
        }
        Ok(SUCCESS)
    }

    /// The scene as the player frames it.
    fn picture(&self) -> std::result::Result<Vec<u8>, String> {
        let player = match &self.player {
            Some(path) => path.clone(),
            None => {
                find_player().ok_or("cairn-player is neither beside cairn-bake nor in the path")?
            }
        };
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let png = folder.path().join("scene.png");
        let mut command = Command::new(&player);
        command
            .arg(&self.path)
            .args(["--headless", "--size", "960x540", "--out"])
            .arg(&png);
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let message = finish(command).map_err(|error| format!("{}: {error}", player.display()))?;
        std::fs::read(&png).map_err(|error| {
            let said = message.lines().last().unwrap_or_default();
            format!("{}: {error}; it said: {said}", player.display())
        })
    }
}

fn summary(path: &Path) -> Result<Summary> {
    let bytes = std::fs::read(path).map_err(|error| BakeError::io(path, error))?;
    serde_json::from_slice(&bytes).map_err(|error| {
        let what = format!(
            "not the summary of a bake ({error}); write one with `cairn-bake ... --json > {}`",
            path.display()
        );
        BakeError::input("json", &origin(path), what)
    })
}

/// The player beside this program, or in the path.
fn find_player() -> Option<PathBuf> {
    let name = format!("cairn-player{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe()
        .ok()
        .and_then(|program| Some(program.parent()?.to_owned()));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = beside.into_iter().chain(std::env::split_paths(&path));
    folders
        .map(|folder| folder.join(&name))
        .find(|file| file.is_file())
}

/// Waits for a program, and gives what it wrote to standard error.
fn finish(mut command: Command) -> std::result::Result<String, String> {
    use std::io::Read;
    let mut child = command.spawn().map_err(|error| error.to_string())?;
    let mut stderr = child.stderr.take();
    // Read by another thread: a program that writes much would wait for its reader for ever.
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        if let Some(stderr) = &mut stderr {
            let _ = stderr.read_to_string(&mut text);
        }
        text
    });
    let start = Instant::now();
    let status = loop {
        match child.try_wait().map_err(|error| error.to_string())? {
            Some(status) => break status,
            None if start.elapsed() > PATIENCE => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("not done after {} seconds", PATIENCE.as_secs()));
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let text = reader.join().unwrap_or_default();
    if status.success() {
        return Ok(text);
    }
    let said = text.lines().last().unwrap_or("nothing");
    Err(format!("{status}: {said}"))
}
