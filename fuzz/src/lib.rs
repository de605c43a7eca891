//! What hostile bytes may reach, as functions of bytes: each ends in a value or in a typed error, soon.

pub mod mutate;
mod seal;

use std::path::{Path, PathBuf};

use cairn_bake::import::{decode_image, import, load_environment};
use cairn_bake::look::Contents;
use cairn_bake::prepare::prepare;
use cairn_bake::scene::{Image, Origin};
use cairn_bake::{BakeError, Diagnostic};
use cairn_format::Package;

/// Most texels of an image here: fuzzers look for wrong turns, not for work.
const LIMIT_PIXELS: u64 = 1 << 16;

/// An entry for bytes of unknown origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A glTF text: import, then the whole of geometry.
    Gltf,
    /// The same of a GLB container.
    Glb,
    /// An image: PNG, JPEG, WebP, KTX2, DDS.
    Image,
    /// A panorama: Radiance, OpenEXR.
    Panorama,
    /// A package: open, verify, examine, inspect. Hashes are made right first, or nothing behind them were reached.
    Package,
}

/// How an input ended; that it ends in one of the two is what is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Accepted,
    Refused,
}

impl Target {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Gltf,
        Self::Glb,
        Self::Image,
        Self::Panorama,
        Self::Package,
    ];

    /// Name of its binary, its seeds and its dictionary.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gltf => "gltf",
            Self::Glb => "glb",
            Self::Image => "image",
            Self::Panorama => "panorama",
            Self::Package => "package",
        }
    }

    /// Feeds `data` to the target.
    ///
    /// # Panics
    /// On a bug: a panic of what is tested, or an error that names no place to look at.
    pub fn run(self, data: &[u8]) -> Verdict {
        match self {
            Self::Gltf => scene(data, "scene.gltf"),
            Self::Glb => scene(data, "scene.glb"),
            Self::Image => image(data),
            Self::Panorama => judged(load_environment(&written(data, "sky.hdr"))),
            Self::Package => package(data),
        }
    }
}

/// The folder beside this file's crate.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

/// `data` as a file of this thread's own, in memory where the system has a place for that.
fn written(data: &[u8], name: &str) -> PathBuf {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir_in("/dev/shm")
            .or_else(|_| tempfile::tempdir())
            .expect("a temporary folder");
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        std::fs::write(&path, data).expect("a temporary file");
        path
    })
}

fn scene(data: &[u8], name: &str) -> Verdict {
    let path = written(data, name);
    judged(import(&path).and_then(|mut scene| {
        prepare(&mut scene, &|_| {})?;
        for image in &scene.images {
            let _ = judged(decode_image(image, LIMIT_PIXELS));
        }
        Ok(())
    }))
}

fn image(data: &[u8]) -> Verdict {
    let image = Image {
        name: "image".into(),
        bytes: data.to_vec(),
        origin: Origin {
            file: "scene.gltf".into(),
            pointer: "/images/0".into(),
        },
        ..Image::default()
    };
    judged(decode_image(&image, LIMIT_PIXELS))
}

fn package(data: &[u8]) -> Verdict {
    let mut bytes = data.to_vec();
    seal::seal(&mut bytes);
    let mut broken = 0_u64;
    Package::examine_bytes(&bytes, &mut |_| {
        broken += 1;
        std::ops::ControlFlow::Continue(())
    });
    let Ok(package) = Package::from_bytes(&bytes) else {
        assert!(broken > 0, "what open refuses, examine must find");
        return Verdict::Refused;
    };
    let verified = package.verify();
    assert!(
        verified.is_ok() || broken > 0,
        "what verify refuses, examine must find: {verified:?}"
    );
    // The package is open: whatever its bulk data holds, it can be looked at.
    let _ = Contents::of(&package);
    if verified.is_ok() {
        Verdict::Accepted
    } else {
        Verdict::Refused
    }
}

fn judged<T>(result: Result<T, BakeError>) -> Verdict {
    match result {
        Ok(_) => Verdict::Accepted,
        Err(BakeError::Input(Diagnostic { file, message, .. })) => {
            assert!(!file.is_empty() && !message.is_empty());
            Verdict::Refused
        }
        Err(BakeError::Io { .. }) => Verdict::Refused,
        Err(bug @ BakeError::Package(_)) => panic!("{bug}"),
    }
}
