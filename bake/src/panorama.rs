//! The environment of a bake: out of its file, or as the cache has it.

use std::path::{Path, PathBuf};

use cairn_format::scene::Environment;

use crate::cache::{Inputs, Kind, Session};
use crate::diagnostic::{Diagnostic, Result};
use crate::encode::Codec;
use crate::environment::EnvironmentOptions;
use crate::import::{EnvironmentImage, decode_environment, environment_pixels, read_environment};
use crate::memory;
use crate::scene::Source;
use crate::sky;
use crate::textures::Texels;

/// A panorama on its way into the package.
pub struct Panorama {
    path: PathBuf,
    bytes: Vec<u8>,
    pub source: Source,
    /// Decoded where the cache does not have what becomes of it.
    image: Option<EnvironmentImage>,
    light: EnvironmentOptions,
    codec: Codec,
}

/// What the package stores of an environment.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
pub struct StoredSky {
    pub environment: Environment,
    /// The importance table's section.
    pub alias: Vec<u8>,
    pub diagnostics: Vec<Diagnostic>,
    texels: Texels,
}

impl Panorama {
    /// Reads the file; a broken one is an error now, before time is spent on the scene.
    ///
    /// # Errors
    /// As [`crate::import::load_environment`], and `limit-memory` where the work on it takes more than `limit_memory`.
    pub fn open(
        path: &Path,
        light: &EnvironmentOptions,
        codec: Codec,
        limit_memory: u64,
        session: &Session,
    ) -> Result<Self> {
        let (bytes, source) = read_environment(path)?;
        if let Some(pixels) = environment_pixels(&bytes) {
            memory::check_panorama(path, bytes.len() as u64, pixels, limit_memory)?;
        }
        let mut panorama = Self {
            path: path.to_owned(),
            bytes,
            source,
            image: None,
            light: light.clone(),
            codec,
        };
        if !session.holds(&panorama.inputs()) {
            panorama.image = Some(panorama.decode()?);
        }
        Ok(panorama)
    }

    /// Bytes that it takes while nothing is done with it.
    pub fn held_bytes(&self) -> u64 {
        let texels = self.image.as_ref().map_or(&[][..], |image| &image.texels);
        (self.bytes.len() + size_of_val(texels)) as u64
    }

    fn decode(&self) -> Result<EnvironmentImage> {
        decode_environment(&self.path, &self.bytes, self.source.clone())
    }

    fn inputs(&self) -> Inputs {
        let name = self.path.file_name().unwrap_or_default();
        Inputs::new(Kind::Environment, module_path!(), name.to_string_lossy())
            .hash("panorama", &self.source.hash)
            .settings("settings", &self.light)
            .settings("storage", &self.codec)
    }

    /// Appends the cubes to `texels`; indices in the result point there.
    ///
    /// # Errors
    /// Those of decoding, where the cache promised too much.
    pub fn store(
        &mut self,
        texels: &mut Texels,
        session: &Session,
        progress: &(dyn Fn(&str, f32) + Sync),
    ) -> Result<StoredSky> {
        let image = self.image.take();
        let make = || {
            let image = match image {
                Some(image) => image,
                None => self.decode()?,
            };
            Ok(self.make(image, progress))
        };
        let mut stored = session.fetch(|| self.inputs(), make)?;
        let first = texels.append(std::mem::take(&mut stored.texels));
        shift(&mut stored.environment, first);
        // The file may have had another name when its sky was made.
        let file = self.path.display().to_string();
        for diagnostic in &mut stored.diagnostics {
            diagnostic.file.clone_from(&file);
        }
        Ok(stored)
    }

    fn make(
        &self,
        mut image: EnvironmentImage,
        progress: &(dyn Fn(&str, f32) + Sync),
    ) -> StoredSky {
        let products = sky::bake(&mut image, &self.light, progress);
        let mut texels = Texels::default();
        let environment = sky::store(&mut texels, &image, &products, self.codec);
        let alias = products.importance.map(|table| table.to_bytes());
        StoredSky {
            environment,
            alias: alias.unwrap_or_default(),
            diagnostics: image.diagnostics,
            texels,
        }
    }
}

/// Moves the indices of images.
fn shift(environment: &mut Environment, by: u32) {
    // Every field by name: a new index does not compile until it is moved.
    let Environment {
        sky,
        irradiance,
        prefiltered,
        prefiltered_roughness: _,
        scale: _,
        sun: _,
        irradiance_sh: _,
        source_width: _,
        source_height: _,
        replaced_texels: _,
        clamped_texels: _,
    } = environment;
    for index in [sky, irradiance, prefiltered] {
        *index += by;
    }
}

/// Appends the BRDF table; returns its image index.
///
/// # Errors
/// None: making it cannot fail.
pub fn store_lut(texels: &mut Texels, sheen: bool, session: &Session) -> Result<u32> {
    let inputs =
        || Inputs::new(Kind::BrdfTable, module_path!(), "BRDF table").settings("sheen", &sheen);
    let table: Texels = session.fetch(inputs, || {
        let mut table = Texels::default();
        sky::store_lut(&mut table, sheen);
        Ok(table)
    })?;
    Ok(texels.append(table))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Radiance file of 8 x 5 texels, one of them bright; its shape is warned of.
    fn write_panorama(path: &Path) {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 5 +X 8\n".to_vec();
        for texel in 0..40u8 {
            bytes.extend([100, 90, texel, if texel == 9 { 140 } else { 128 }]);
        }
        std::fs::write(path, bytes).expect("written");
    }

    #[test]
    fn a_kept_sky_is_what_was_baked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        let light = EnvironmentOptions {
            sky_size: Some(64),
            prefiltered_size: 16,
            ..EnvironmentOptions::default()
        };
        let bake = |file: &str, session: &Session| {
            let codec = Codec::Half;
            let mut panorama =
                Panorama::open(&path(file), &light, codec, u64::MAX, session).expect("a sky");
            let decoded = panorama.image.is_some();
            // Something before it, which must not matter.
            let mut texels = Texels::default();
            store_lut(&mut texels, false, session).expect("a table");
            let stored = panorama
                .store(&mut texels, session, &|_, _| ())
                .expect("a sky");
            for row in &mut texels.report {
                (row.seconds, row.throughput) = (0.0, None);
            }
            let text = format!("{texels:?} {:?} {:?}", stored.environment, stored.alias);
            (text, stored.diagnostics, decoded)
        };
        let session = || Session::open(&path("cache"), &path("scene"), &path("out"));
        write_panorama(&path("sky.hdr"));
        let (cold, warnings, decoded) = bake("sky.hdr", &Session::off());
        assert!(decoded && !warnings.is_empty());
        assert!(bake("sky.hdr", &session()) == (cold.clone(), warnings.clone(), true));
        assert!(bake("sky.hdr", &session()) == (cold.clone(), warnings, false));
        // Another name has other messages and the same bytes.
        std::fs::rename(path("sky.hdr"), path("renamed.hdr")).expect("renamed");
        let (warm, warnings, decoded) = bake("renamed.hdr", &session());
        assert!(warm == cold && !decoded);
        assert!(
            warnings
                .iter()
                .all(|warning| warning.file.ends_with("renamed.hdr"))
        );
    }
}
