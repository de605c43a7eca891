//! Proof that a bake is a function of its input: two bakes from nothing, at one and at many threads, compared.

use std::num::NonZeroUsize;

use serde::Serialize;

use crate::diagnostic::{BakeError, Result};
use crate::pipeline::{Options, bake};
use crate::progress::Progress;
use crate::report::Summary;

/// One of the two bakes.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    pub threads: usize,
    pub seconds: f64,
    /// Of header, section table and root, in hexadecimal.
    pub content_hash: String,
}

/// A section in both packages; `None` where one has it not.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    pub section: String,
    pub hashes: [Option<String>; 2],
    pub equal: bool,
}

/// What two bakes of one input gave.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    pub equal: bool,
    pub runs: [Run; 2],
    /// Every section of either package. Where all are equal and `equal` is not, the roots differ.
    pub sections: Vec<Compared>,
}

/// Bakes `options` twice without a cache, at one thread and at `threads`; the output of `options` is not touched.
///
/// # Errors
/// Those of a bake; [`BakeError::Io`] where there is no room for the packages or no thread to be had.
pub fn bake_twice(
    options: &Options,
    threads: NonZeroUsize,
    progress: &dyn Progress,
) -> Result<Verdict> {
    let folder =
        tempfile::tempdir().map_err(|error| BakeError::io(&std::env::temp_dir(), error))?;
    let run = |threads: usize| -> Result<Summary> {
        let options = Options {
            output: folder.path().join(format!("{threads}.cairn")),
            cache: None,
            ..options.clone()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool =
            pool.map_err(|error| BakeError::io(&options.input, std::io::Error::other(error)))?;
        pool.install(|| bake(&options, progress))
    };
    let summaries = [run(1)?, run(threads.get())?];
    Ok(compare(summaries, [1, threads.get()]))
}

fn compare(summaries: [Summary; 2], threads: [usize; 2]) -> Verdict {
    let mut names: Vec<&str> = Vec::new();
    for section in summaries.iter().flat_map(|summary| &summary.sections) {
        if !names.contains(&section.name) {
            names.push(section.name);
        }
    }
    let sections = names.into_iter().map(|name| {
        let hashes = summaries.each_ref().map(|summary| {
            let section = summary.sections.iter().find(|section| section.name == name);
            section.map(|section| section.hash.clone())
        });
        Compared {
            section: name.to_owned(),
            equal: hashes[0] == hashes[1],
            hashes,
        }
    });
    Verdict {
        equal: summaries[0].content_hash == summaries[1].content_hash,
        sections: sections.collect(),
        runs: std::array::from_fn(|run| Run {
            threads: threads[run],
            seconds: summaries[run].seconds,
            content_hash: summaries[run].content_hash.clone(),
        }),
    }
}

impl Verdict {
    /// A line a section, and the verdict.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for section in &self.sections {
            let [one, many] = section
                .hashes
                .each_ref()
                .map(|hash| hash.as_deref().unwrap_or("absent"));
            text += &match section.equal {
                true => format!("  {:<20} {one}\n", section.section),
                false => format!(
                    "  {:<20} {one}\n  {:<20} {many}  differs\n",
                    section.section, ""
                ),
            };
        }
        let [one, many] = &self.runs;
        text += &format!(
            "  {:<20} {} at 1 thread, {:.3} s\n",
            "package", one.content_hash, one.seconds
        );
        text += &format!(
            "  {:<20} {} at {} threads, {:.3} s\n",
            "package", many.content_hash, many.threads, many.seconds
        );
        text += if self.equal { "equal\n" } else { "NOT equal\n" };
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Section;

    fn summary(content: &str, sections: &[(&'static str, &str)]) -> Summary {
        let section = |(name, hash): &(&'static str, &str)| Section {
            name,
            bytes: 1,
            hash: (*hash).to_owned(),
        };
        Summary {
            content_hash: content.into(),
            sections: sections.iter().map(section).collect(),
            ..Summary::default()
        }
    }

    #[test]
    fn any_difference_is_seen() {
        let left = summary("x", &[("vertices", "1"), ("indices", "2")]);
        let same = compare([left.clone(), left.clone()], [1, 4]);
        assert!(same.equal && same.sections.iter().all(|section| section.equal));
        assert!(same.text().ends_with("\nequal\n"));
        let right = summary("y", &[("vertices", "1"), ("indices", "3"), ("texels", "4")]);
        let other = compare([left, right], [1, 4]);
        let equal: Vec<bool> = other.sections.iter().map(|section| section.equal).collect();
        assert_eq!((other.equal, equal), (false, vec![true, false, false]));
        let text = other.text();
        assert!(
            text.contains("absent") && text.ends_with("NOT equal\n"),
            "{text}"
        );
    }
}
