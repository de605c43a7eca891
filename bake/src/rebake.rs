//! Whether a bake would change anything, and what the next one must know of it.

use std::path::PathBuf;

use crate::cache::{Inputs, Kind, Session, absolute};
use crate::pipeline::Options;
use crate::report::Summary;
use crate::scene::Scene;
use crate::strict::Strict;

/// The cache of a bake.
pub fn session(options: &Options) -> Session {
    match &options.cache {
        Some(folder) => Session::open(folder, &options.input, &options.output),
        None => Session::off(),
    }
}

/// What is asked for, apart from the content of files: the same request on the same files writes the same package
/// and says the same.
pub fn request(options: &Options) -> Inputs {
    // Whatever may be added to the options counts, but for where things lie and what is checked anyhow.
    let settings = Options {
        output: PathBuf::new(),
        cache: None,
        strict: Strict::No,
        ..options.clone()
    };
    Inputs::new(Kind::Package, module_path!(), "package")
        .settings("settings", &settings)
        .settings("scene", &absolute(&options.input))
}

/// The summary of a bake that need not be done, because everything is as it was after the last.
pub fn unchanged(session: &Session, options: &Options) -> Option<Summary> {
    if !session.keeps() {
        return None;
    }
    let summary = session.unchanged(&request(options), &options.output)?;
    Some(Summary {
        output: options.output.display().to_string(),
        ..summary
    })
}

/// Remembers a bake that is over.
pub fn remember(
    session: Session,
    options: &Options,
    scene: &Scene,
    panorama: Option<[u8; 32]>,
    content_hash: [u8; 32],
    summary: &mut Summary,
) {
    if !session.keeps() {
        return;
    }
    let files = scene
        .sources
        .iter()
        .map(|source| (source.location.clone(), source.hash));
    let environment = options.environment.clone().zip(panorama);
    let output = (options.output.as_path(), content_hash);
    let files = files.chain(environment);
    session.finish(request(options), &options.input, files, output, summary);
}
