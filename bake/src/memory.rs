//! The memory that a bake may take: textures are decoded fewer at a time to stay within, and what cannot is refused.

use std::ops::Range;
use std::path::Path;

use crate::diagnostic::{BakeError, Result};
use crate::import::image_header;
use crate::look::bytes_text;
use crate::scene::{Image, Origin, Scene};

/// Bytes that a bake may take unless it is told otherwise.
pub const DEFAULT_LIMIT_MEMORY: u64 = 16_000_000_000;

/// Bytes for each texel of an image that is being encoded: 16-bit source, f32 level and the next one, codes, blocks and
/// the errors of blocks.
const BYTES_PER_TEXEL: u64 = 48;
/// Bytes for each corner of a triangle while geometry is prepared, all attributes and orders included; twice what a mesh
/// of 1.15 million triangles was seen to take.
const BYTES_PER_CORNER: u64 = 64;

/// Bytes for each pixel of a panorama while it becomes cubes, of which a sky's finest takes a fourth; a panorama of 33
/// million was seen to take 43 beside its file.
const BYTES_PER_PANORAMA_PIXEL: u64 = 48;

/// Bytes that the scene takes before any image is decoded.
fn held(scene: &Scene) -> u64 {
    let corners: u64 = scene
        .meshes
        .iter()
        .flat_map(|mesh| &mesh.primitives)
        .map(|primitive| primitive.positions.len().max(primitive.indices.len()) as u64)
        .sum();
    let files: u64 = scene
        .images
        .iter()
        .map(|image| image.bytes.len() as u64)
        .sum();
    corners
        .saturating_mul(BYTES_PER_CORNER)
        .saturating_add(files)
}

/// What is left of `limit` for images, beside the geometry and a panorama of `panorama` bytes.
///
/// # Errors
/// `limit-memory` where these alone take more.
pub fn left_for_images(scene: &Scene, panorama: u64, limit: u64) -> Result<u64> {
    let held = held(scene).saturating_add(panorama);
    limit
        .checked_sub(held)
        .ok_or_else(|| refused("the geometry", held, limit, &scene.origin("")))
}

/// Whether a panorama of `pixels` in a file of `bytes` can be worked on.
///
/// # Errors
/// `limit-memory` where it takes more than `limit`.
pub fn check_panorama(path: &Path, bytes: u64, pixels: u64, limit: u64) -> Result<()> {
    let needed = pixels
        .saturating_mul(BYTES_PER_PANORAMA_PIXEL)
        .saturating_add(bytes);
    if needed <= limit {
        return Ok(());
    }
    let origin = Origin {
        file: path.display().to_string(),
        pointer: String::new(),
    };
    Err(refused("the environment", needed, limit, &origin))
}

/// Bytes that encoding an image takes.
///
/// # Errors
/// `limit-memory` where that is more than is left, and those of [`image_header`].
pub fn of_image(image: &Image, left: u64, limit_pixels: u64) -> Result<u64> {
    let header = image_header(image, limit_pixels)?;
    let texels = u64::from(header.width) * u64::from(header.height);
    let needed = texels.saturating_mul(BYTES_PER_TEXEL);
    if needed > left {
        let what = format!("image `{}`", image.name);
        return Err(refused(&what, needed, left, &image.origin));
    }
    Ok(needed)
}

fn refused(what: &str, needed: u64, left: u64, origin: &Origin) -> BakeError {
    let message = format!(
        "{what} takes about {}, and --limit-memory leaves {}; raise it or make the input smaller",
        bytes_text(needed),
        bytes_text(left)
    );
    BakeError::input("limit-memory", origin, message)
}

/// Consecutive jobs that may be in memory together: of each batch, the `threads` largest fit into `left`. A job that
/// does not fit has a batch of its own.
pub fn batches(needed: &[u64], threads: usize, left: u64) -> Vec<Range<usize>> {
    let fits = |range: Range<usize>| {
        let mut largest = needed[range].to_vec();
        largest.sort_unstable_by(|a, b| b.cmp(a));
        let together = largest.iter().take(threads);
        together.fold(0, |sum: u64, one| sum.saturating_add(*one)) <= left
    };
    let mut batches: Vec<Range<usize>> = Vec::new();
    for job in 0..needed.len() {
        match batches.last_mut() {
            Some(batch) if fits(batch.start..job + 1) => batch.end = job + 1,
            _ => batches.push(job..job + 1),
        }
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_hold_what_fits_together() {
        let one = |end| vec![Range { start: 0, end }];
        assert_eq!(batches(&[5, 5, 5], 2, 100), one(3));
        // Any number of jobs, as only two are in memory at once.
        assert_eq!(batches(&[5; 9], 2, 10), one(9));
        assert_eq!(batches(&[5, 6, 5, 5], 2, 10), [0..1, 1..2, 2..4]);
        assert_eq!(batches(&[50, 1], 1, 10), [0..1, 1..2]);
        assert_eq!(batches(&[], 4, 10), [] as [Range<usize>; 0]);
    }

    #[test]
    fn batches_are_all_jobs_in_order() {
        let needed: Vec<u64> = (0..200).map(|index| index * 7919 % 101).collect();
        for threads in [1, 2, 16] {
            for left in [0, 60, 150, 1000] {
                let batches = batches(&needed, threads, left);
                let jobs: Vec<usize> = batches.into_iter().flatten().collect();
                assert_eq!(jobs, (0..200).collect::<Vec<_>>());
            }
        }
    }
}
