//! Turns UASTC blocks into what the device samples, while they are uploaded.
//!
//! To BC7 and ASTC the blocks are rewritten, not decoded and compressed again: ASTC without loss, BC7 nearly so. A
//! device with neither gets plain texels. ETC2 is no target: all of its devices that know Vulkan 1.3 read ASTC, which
//! keeps more.

use basisu::uastc::{astc_pack, bc7, unpack};
use cairn_format::TextureFormat;

use crate::gpu::{Blocks, vk};

/// Bytes of a UASTC block, and of the blocks that it becomes.
const BLOCK: usize = 16;
/// Texels along the edge of a block.
const EDGE: usize = 4;
/// Blocks below which another thread costs more than it gains.
const BLOCKS_PER_THREAD: usize = 4096;

/// What UASTC becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Bc7,
    Astc,
    Rgba8,
}

impl Target {
    /// The best of what a device reads. BC before ASTC: desktop drivers that have both often emulate ASTC.
    pub(super) fn of(blocks: Blocks) -> Self {
        match blocks {
            Blocks { bc: true, .. } => Self::Bc7,
            Blocks { astc: true, .. } => Self::Astc,
            _ => Self::Rgba8,
        }
    }

    /// The device's format.
    pub(super) fn vulkan(self, srgb: bool) -> vk::Format {
        match (self, srgb) {
            (Self::Bc7, false) => vk::Format::BC7_UNORM_BLOCK,
            (Self::Bc7, true) => vk::Format::BC7_SRGB_BLOCK,
            (Self::Astc, false) => vk::Format::ASTC_4X4_UNORM_BLOCK,
            (Self::Astc, true) => vk::Format::ASTC_4X4_SRGB_BLOCK,
            (Self::Rgba8, false) => vk::Format::R8G8B8A8_UNORM,
            (Self::Rgba8, true) => vk::Format::R8G8B8A8_SRGB,
        }
    }

    /// A format of the same layout.
    pub(super) fn layout(self) -> TextureFormat {
        match self {
            Self::Bc7 | Self::Astc => TextureFormat::Bc7Unorm,
            Self::Rgba8 => TextureFormat::Rgba8Unorm,
        }
    }

    /// Transcodes rows of blocks to `extent` texels, on all cores where it is worth it.
    ///
    /// # Errors
    /// The index of a block that is none of UASTC's.
    pub(super) fn transcode(
        self,
        stored: &[u8],
        staged: &mut [u8],
        extent: [u32; 2],
        srgb: bool,
    ) -> Result<(), usize> {
        let across = (extent[0] as usize).div_ceil(EDGE);
        let rows = (extent[1] as usize).div_ceil(EDGE);
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let threads = (across * rows / BLOCKS_PER_THREAD).clamp(1, cores);
        let share = rows.div_ceil(threads);
        let staged_row = self.layout().level_bytes(extent[0], EDGE as u32) as usize;
        let width = extent[0] as usize;
        if threads == 1 {
            return self.part(stored, staged, width, srgb);
        }
        let parts = stored
            .chunks(share * across * BLOCK)
            .zip(staged.chunks_mut(share * staged_row));
        std::thread::scope(|scope| {
            let workers: Vec<_> = parts
                .map(|(stored, staged)| scope.spawn(move || self.part(stored, staged, width, srgb)))
                .collect();
            for (part, worker) in workers.into_iter().enumerate() {
                let done = worker
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                done.map_err(|block| part * share * across + block)?;
            }
            Ok(())
        })
    }

    fn part(self, stored: &[u8], staged: &mut [u8], width: usize, srgb: bool) -> Result<(), usize> {
        let blocks = stored.as_chunks::<BLOCK>().0;
        let rewrite: fn(&[u8; BLOCK]) -> Option<[u8; BLOCK]> = match self {
            Self::Bc7 => bc7::transcode_uastc_to_bc7,
            Self::Astc => astc_pack::transcode_uastc_to_astc,
            Self::Rgba8 => return unpacked(blocks, staged, width, srgb),
        };
        let staged = staged.as_chunks_mut::<BLOCK>().0;
        for (index, (block, staged)) in blocks.iter().zip(staged).enumerate() {
            *staged = rewrite(block).ok_or(index)?;
        }
        Ok(())
    }
}

/// Decodes blocks to rows of RGBA texels; the last row of blocks may lie partly outside.
fn unpacked(
    blocks: &[[u8; BLOCK]],
    staged: &mut [u8],
    width: usize,
    srgb: bool,
) -> Result<(), usize> {
    let across = width.div_ceil(EDGE);
    for (index, block) in blocks.iter().enumerate() {
        let texels = unpack::unpack_uastc(block, srgb).ok_or(index)?;
        let [x, y] = [index % across * EDGE, index / across * EDGE];
        for (texel, color) in texels.iter().enumerate() {
            let [x, y] = [x + texel % EDGE, y + texel / EDGE];
            let place = (y * width + x) * 4;
            if x < width && place < staged.len() {
                staged[place..place + 4].copy_from_slice(&color.c);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod astc_tests;

#[cfg(test)]
mod tests {
    use super::*;

    /// A UASTC block of one colour: mode 8, then the channels.
    fn solid(color: [u8; 4]) -> [u8; BLOCK] {
        let bits = 0x17 | u128::from(u32::from_le_bytes(color)) << 5;
        bits.to_le_bytes()
    }

    /// Blocks of an image, each of a colour of its own.
    fn blocks(extent: [u32; 2]) -> Vec<u8> {
        let across = extent[0].div_ceil(4);
        let count = across * extent[1].div_ceil(4);
        let color = |block: u32| solid([block as u8, (block >> 8) as u8, 77, 255]);
        (0..count).flat_map(color).collect()
    }

    #[test]
    fn texels_come_from_their_blocks_at_any_size_and_number_of_threads() {
        // The last is worth several threads.
        for extent in [[1, 1], [5, 3], [4, 9], [130, 66], [1021, 259]] {
            let stored = blocks(extent);
            let mut staged = vec![0; (extent[0] * extent[1] * 4) as usize];
            let done = Target::Rgba8.transcode(&stored, &mut staged, extent, true);
            assert_eq!(done, Ok(()));
            let across = extent[0].div_ceil(4);
            for (index, texel) in (0..).zip(staged.chunks(4)) {
                let block = index / extent[0] / 4 * across + index % extent[0] / 4;
                let expected = [block as u8, (block >> 8) as u8, 77, 255];
                assert_eq!(texel, expected, "texel {index} of {extent:?}");
            }
        }
    }

    #[test]
    fn rewritten_blocks_keep_their_places() {
        let extent = [1021, 259];
        let stored = blocks(extent);
        for target in [Target::Bc7, Target::Astc] {
            let mut all = vec![0; stored.len()];
            let done = target.transcode(&stored, &mut all, extent, false);
            assert_eq!(done, Ok(()));
            for at in [0, 16, 16 * 255, stored.len() - 16] {
                let mut one = [0; BLOCK];
                let done = target.transcode(&stored[at..at + BLOCK], &mut one, [4, 4], false);
                assert_eq!((done, one.as_slice()), (Ok(()), &all[at..at + BLOCK]));
            }
        }
    }

    #[test]
    fn a_block_of_no_mode_is_named() {
        for extent in [[8, 8], [1021, 259]] {
            let mut stored = blocks(extent);
            let last = stored.len() / BLOCK - 1;
            stored[last * BLOCK] = 0x45;
            for target in [Target::Bc7, Target::Astc, Target::Rgba8] {
                let length = target.layout().level_bytes(extent[0], extent[1]) as usize;
                let done = target.transcode(&stored, &mut vec![0; length], extent, true);
                assert_eq!(done, Err(last), "{target:?}");
            }
        }
    }

    #[test]
    fn the_best_that_a_device_reads_is_chosen() {
        let target = |bc, astc| Target::of(Blocks { bc, astc });
        assert_eq!(target(true, true), Target::Bc7);
        assert_eq!(target(false, true), Target::Astc);
        assert_eq!(target(false, false), Target::Rgba8);
    }
}
