//! Golden images: comparison, acceptance, difference pictures.

use std::path::{Path, PathBuf};

use cairn_format::Package;

/// An 8-bit sRGB image, 3 bytes a texel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgb {
    pub width: u32,
    pub height: u32,
    pub texels: Vec<u8>,
}

/// Difference of two images in 8-bit steps, over all channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    pub mean: f64,
    pub p99: u8,
    pub max: u8,
}

/// Bounds of a golden: the image may differ by rounding between driver versions, not by more.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub mean: f64,
    pub p99: u8,
}

impl Rgb {
    /// Drops the alpha of an RGBA image.
    pub fn from_rgba(width: u32, height: u32, rgba: &[u8]) -> Self {
        let texels = rgba
            .chunks_exact(4)
            .flat_map(|texel| [texel[0], texel[1], texel[2]])
            .collect();
        Self {
            width,
            height,
            texels,
        }
    }

    /// Reads an 8-bit RGB or RGBA PNG.
    pub fn read(path: &Path) -> Result<Self, String> {
        let fail = |error: String| format!("{}: {error}", path.display());
        let file = std::fs::File::open(path).map_err(|error| fail(error.to_string()))?;
        let mut reader = png::Decoder::new(std::io::BufReader::new(file))
            .read_info()
            .map_err(|error| fail(error.to_string()))?;
        let mut bytes = vec![
            0;
            reader
                .output_buffer_size()
                .ok_or_else(|| fail("too large".into()))?
        ];
        let info = reader
            .next_frame(&mut bytes)
            .map_err(|error| fail(error.to_string()))?;
        bytes.truncate(info.buffer_size());
        match info.color_type {
            png::ColorType::Rgb => Ok(Self {
                width: info.width,
                height: info.height,
                texels: bytes,
            }),
            png::ColorType::Rgba => Ok(Self::from_rgba(info.width, info.height, &bytes)),
            other => Err(fail(format!("{other:?} images are not compared"))),
        }
    }

    /// Writes a PNG, creating folders.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        let fail = |error: String| format!("{}: {error}", path.display());
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
        }
        let file = std::fs::File::create(path).map_err(|error| fail(error.to_string()))?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        let written = encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&self.texels));
        written.map_err(|error| fail(error.to_string()))
    }

    /// Difference to an image of the same size; `None` where the sizes differ.
    pub fn difference(&self, other: &Self) -> Option<Difference> {
        if (self.width, self.height) != (other.width, other.height) {
            return None;
        }
        let mut histogram = [0u64; 256];
        for (a, b) in self.texels.iter().zip(&other.texels) {
            histogram[usize::from(a.abs_diff(*b))] += 1;
        }
        let count = self.texels.len().max(1) as u64;
        let sum: u64 = histogram
            .iter()
            .zip(0u64..)
            .map(|(count, step)| count * step)
            .sum();
        let mut seen = 0;
        let p99 = histogram.iter().position(|bucket| {
            seen += bucket;
            seen * 100 >= count * 99
        });
        Some(Difference {
            mean: sum as f64 / count as f64,
            p99: p99.unwrap_or(255) as u8,
            max: histogram
                .iter()
                .rposition(|bucket| *bucket > 0)
                .unwrap_or(0) as u8,
        })
    }

    /// The difference, times eight and clamped, as a picture.
    fn amplified_difference(&self, other: &Self) -> Self {
        let amplify = |(a, b): (&u8, &u8)| a.abs_diff(*b).saturating_mul(8);
        Self {
            texels: self.texels.iter().zip(&other.texels).map(amplify).collect(),
            ..*self
        }
    }
}

/// Compares `image` with `tests/goldens/NAME.png`.
///
/// `UPDATE_GOLDEN=NAME` (or `all`) accepts the image instead. On failure the image and the difference are
/// written to `tests/current`.
///
/// # Panics
/// Where they differ by more than `bounds`.
#[track_caller]
pub fn assert_golden(name: &str, image: &Rgb, bounds: Bounds) {
    if let Err(error) = check_golden(name, image, bounds) {
        panic!("{error}");
    }
}

fn check_golden(name: &str, image: &Rgb, bounds: Bounds) -> Result<(), String> {
    let golden_path = folder("goldens").join(format!("{name}.png"));
    let update = std::env::var("UPDATE_GOLDEN").unwrap_or_default();
    if update == name || update == "all" {
        return image.write(&golden_path);
    }
    let current = folder("current").join(format!("{name}.png"));
    let accept = format!("accept with: UPDATE_GOLDEN={name} ./run test golden");
    let golden = Rgb::read(&golden_path).map_err(|error| {
        let _ = image.write(&current);
        format!("{error}; the image is in {}; {accept}", current.display())
    })?;
    match image.difference(&golden) {
        Some(difference) if difference.mean <= bounds.mean && difference.p99 <= bounds.p99 => {
            Ok(())
        }
        difference => {
            image.write(&current)?;
            if difference.is_some() {
                let picture = image.amplified_difference(&golden);
                picture.write(&folder("current").join(format!("{name}-difference.png")))?;
            }
            Err(format!(
                "golden {name}: {difference:?} exceeds {bounds:?}; see {}; {accept}",
                current.display()
            ))
        }
    }
}

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// The repository's root.
pub fn repository() -> PathBuf {
    folder("..")
}

/// Options that bake `assets/SCENE`, lit by `assets/SKY`, into `output`.
pub fn options(scene: &str, sky: Option<&str>, output: &Path) -> cairn_bake::Options {
    let assets = repository().join("assets");
    cairn_bake::Options {
        environment: sky.map(|sky| assets.join(sky)),
        ..cairn_bake::Options::new(assets.join(scene), output)
    }
}

/// Options that bake any file without an environment, in the least time.
pub fn quick_options(input: &Path, output: &Path) -> cairn_bake::Options {
    cairn_bake::Options {
        textures: cairn_bake::encode::EncodeOptions {
            effort: cairn_bake::encode::Quality::Fast.into(),
            ..Default::default()
        },
        ..cairn_bake::Options::new(input, output)
    }
}

/// Every file below a folder, sorted.
///
/// # Panics
/// Where a folder cannot be read.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut folders = vec![folder.to_owned()];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder that can be read") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// The package of one of our own scenes.
pub fn baked(scene: &str, sky: Option<&str>) -> Package {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("scene.cairn");
    cairn_bake::bake(&options(scene, sky, &output), &cairn_bake::Silent)
        .expect("our own scene bakes");
    let bytes = std::fs::read(output).expect("the package");
    Package::from_bytes(&bytes).expect("a good package")
}

/// A camera of a package.
///
/// # Panics
/// Where it has none of the name.
pub fn camera(package: &Package, name: &str) -> cairn_player::camera::Camera {
    let cameras = &package.scene().cameras;
    let camera = cameras.iter().find(|camera| camera.name == name);
    camera
        .and_then(cairn_player::camera::Camera::from_package)
        .unwrap_or_else(|| panic!("no camera {name}"))
}

/// World bounds of a package's scene.
pub fn bounds(package: &Package) -> cairn_format::Aabb {
    let bounds = &package.scene().bounds;
    cairn_format::Aabb {
        min: cairn_format::scene::natives(&bounds.min).into(),
        max: cairn_format::scene::natives(&bounds.max).into(),
    }
}

/// Whether a Vulkan driver is there. `./run test` sets `CAIRN_REQUIRE_VULKAN`, and then it must be.
///
/// # Panics
/// Where `CAIRN_REQUIRE_VULKAN` is set and no device can be used.
pub fn require_vulkan(test: &str) -> bool {
    let gpu = cairn_player::gpu::Gpu::new(&cairn_player::gpu::GpuOptions::default());
    match gpu {
        Ok(_) => true,
        Err(error) if std::env::var_os("CAIRN_REQUIRE_VULKAN").is_none() => {
            eprintln!("SKIPPED: {test}: {error}");
            false
        }
        Err(error) => panic!("CAIRN_REQUIRE_VULKAN is set, but: {error}"),
    }
}

/// A folder of the real assets beside the checkout (`CAIRN_ASSETS`, else `../shared/assets`); says loudly when
/// it is absent.
pub fn shared_assets(test: &str) -> Option<PathBuf> {
    let named = std::env::var_os("CAIRN_ASSETS").map(PathBuf::from);
    let path = named.unwrap_or_else(|| repository().join("../shared/assets"));
    if path.is_dir() {
        return Some(path);
    }
    eprintln!(
        "SKIPPED: {test}: no real assets at {} (set CAIRN_ASSETS)",
        path.display()
    );
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: u8) -> Rgb {
        Rgb {
            width: 10,
            height: 10,
            texels: vec![value; 300],
        }
    }

    #[test]
    fn one_wrong_texel_of_a_hundred_is_in_the_p99() {
        let mut image = flat(10);
        image.texels[..3].fill(250);
        let difference = image.difference(&flat(10)).expect("same size");
        assert_eq!((difference.p99, difference.max), (0, 240));
        image.texels[3..6].fill(250);
        assert_eq!(image.difference(&flat(10)).expect("same size").p99, 240);
        assert!((difference.mean - 2.4).abs() < 1e-12);
    }

    #[test]
    fn a_golden_that_differs_fails_with_the_command_that_accepts_it() {
        let error = check_golden("no-such-golden", &flat(1), Bounds { mean: 0.0, p99: 0 })
            .expect_err("no file");
        assert!(error.contains("UPDATE_GOLDEN=no-such-golden"), "{error}");
        let _ = std::fs::remove_file(folder("current").join("no-such-golden.png"));
    }

    #[test]
    fn images_survive_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a/b.png");
        flat(7).write(&path).expect("written");
        assert_eq!(Rgb::read(&path), Ok(flat(7)));
    }
}
