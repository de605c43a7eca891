//! Checks a package: every hash, every range, every float, and all that a GPU follows.

use std::path::{Path, PathBuf};

use cairn_format::check::Flow;
use cairn_format::{Error, Package, Part};
use serde::Serialize;

use super::twice::Twice;
use super::{NEGATIVE, SUCCESS, print_json, print_text};
use crate::diagnostic::{Diagnostic, Result};
use crate::look::{origin, printable, refused};

/// `cairn-bake verify PACKAGE`, and `verify --twice SCENE`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Exit codes: 0 sound (--twice: equal), 1 damaged (different), 2 no package, or one of another version (bad input)."
)]
pub struct Verify {
    /// The package; with --twice, the scene.
    path: PathBuf,
    #[command(flatten)]
    twice: Twice,
    /// Print every broken rule, not only the first.
    #[arg(long)]
    all: bool,
    /// Print this many broken rules, and only count the others.
    #[arg(long, value_name = "COUNT", default_value_t = 1000, requires = "all")]
    limit: usize,
    /// Print one JSON object on standard output.
    #[arg(long)]
    json: bool,
    /// Print nothing; the exit code tells.
    #[arg(long, short, conflicts_with = "json")]
    quiet: bool,
}

/// What an examination found.
#[derive(Debug, Serialize)]
struct Verdict {
    path: String,
    sound: bool,
    findings: Vec<Finding>,
    /// Findings beyond the limit.
    omitted: u64,
}

/// A broken rule.
#[derive(Debug, Serialize)]
struct Finding {
    /// `header`, `section table`, `root`, or a section's name.
    part: String,
    /// Bytes from the beginning of the part.
    offset: u64,
    /// Bytes from the beginning of the file.
    file_offset: Option<u64>,
    what: String,
}

impl Verify {
    pub(super) fn run(&self) -> Result<u8> {
        self.twice.check()?;
        if self.twice.twice {
            return self.twice.run(&self.path, self.json, self.quiet);
        }
        let verdict = self.examine()?;
        if self.json {
            print_json(&verdict)?;
        } else if !self.quiet {
            self.print(&verdict)?;
        }
        Ok(if verdict.sound { SUCCESS } else { NEGATIVE })
    }

    fn examine(&self) -> Result<Verdict> {
        let limit = if self.all { self.limit } else { 1 };
        let (mut errors, mut omitted) = (Vec::new(), 0);
        let examined = Package::examine(&self.path, &mut |error| {
            if errors.len() < limit {
                errors.push(error);
            } else {
                omitted += 1;
            }
            if self.all {
                Flow::Continue(())
            } else {
                Flow::Break(())
            }
        });
        examined.map_err(|error| refused(&self.path, error))?;
        let foreign = errors.iter().position(|error| {
            matches!(
                error,
                Error::NotAPackage | Error::Version { .. } | Error::Schema { .. }
            )
        });
        if let Some(index) = foreign {
            return Err(refused(&self.path, errors.swap_remove(index)));
        }
        let places = Places::of(&self.path);
        Ok(Verdict {
            path: self.path.display().to_string(),
            sound: errors.is_empty(),
            findings: errors
                .into_iter()
                .map(|error| places.finding(error))
                .collect(),
            omitted,
        })
    }

    fn print(&self, verdict: &Verdict) -> Result<()> {
        let mut text = String::new();
        for finding in &verdict.findings {
            let mut origin = origin(&self.path);
            origin.pointer = format!("{}, byte {}", finding.part, finding.offset);
            if let Some(offset) = finding.file_offset {
                origin.pointer += &format!(" (file byte {offset})");
            }
            let row = Diagnostic::error("package", &origin, printable(&finding.what));
            text += &format!("{row}\n");
        }
        if verdict.omitted > 0 {
            text += &format!("and {} more\n", verdict.omitted);
        }
        if verdict.sound {
            text += &format!("{}: sound\n", verdict.path);
        }
        print_text(&text)
    }
}

/// Where the parts of a file begin, as far as its header and table can be read.
struct Places {
    root: Option<u64>,
    sections: Vec<(u32, u64)>,
}

impl Places {
    fn of(path: &Path) -> Self {
        use cairn_format::header::{ENTRY_BYTES, HEADER_BYTES};
        let bytes = std::fs::File::open(path).and_then(|file| {
            use std::io::Read;
            let mut head = Vec::new();
            let most = HEADER_BYTES + 64 * ENTRY_BYTES;
            file.take(most).read_to_end(&mut head).map(|_| head)
        });
        let bytes = bytes.unwrap_or_default();
        let word = |at: usize| {
            bytes
                .get(at..at + 4)
                .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        };
        let long = |at: usize| Some(u64::from(word(at)?) | u64::from(word(at + 4)?) << 32);
        let count = word(12).unwrap_or(0).min(64) as usize;
        let row = |index: usize| {
            let at = HEADER_BYTES as usize + index * ENTRY_BYTES as usize;
            Some((word(at)?, long(at + 8)?))
        };
        Self {
            root: long(32),
            sections: (0..count).filter_map(row).collect(),
        }
    }

    fn finding(&self, error: Error) -> Finding {
        let Error::Corrupt { part, offset, what } = error else {
            return Finding {
                part: "header".into(),
                offset: 0,
                file_offset: None,
                what: error.to_string(),
            };
        };
        let start = match part {
            Part::Header => Some(0),
            Part::Table => Some(cairn_format::header::HEADER_BYTES),
            Part::Root => self.root,
            Part::Section(kind) => {
                let row = self
                    .sections
                    .iter()
                    .find(|(section, _)| *section == kind as u32);
                row.map(|(_, offset)| *offset)
            }
        };
        Finding {
            part: part.to_string(),
            offset,
            file_offset: start.and_then(|start| start.checked_add(offset)),
            what,
        }
    }
}
