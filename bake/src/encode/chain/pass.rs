//! Levels that a file has as UASTC blocks: stored as they are, or rewritten as BC7, where nothing alters their texels.

use basisu::uastc::bc7;
use rayon::prelude::*;

use super::{Chain, Codec, Role, bc, error, unorm8};
use crate::encode::{Altered, Target};

/// Change of coverage below which a masked level is the file's own.
const MOST_COVERAGE: f64 = 0.01;
/// Angle between a normal and the one that a shader rebuilds from its x and y, degrees, at the 99th percentile: twice
/// what rounding to 8 bits does to normals that lean by 45 degrees.
const MOST_ANGLE: f64 = 2.0;

/// The UASTC blocks that a source was decoded from.
#[derive(Clone, Copy, Debug)]
pub struct Universal<'a> {
    /// Level 0 first, as many as the file has.
    pub levels: &'a [Vec<u8>],
    /// Whether they hold two channels, in colour and alpha.
    pub pair: bool,
}

impl Chain<'_> {
    /// How levels pass, if the role's format allows it at all. Blocks rewritten as BC7 are made faster than by any
    /// preset, and are worse than those of the default one: they serve where a PSNR is the target.
    fn passing(&self) -> Option<Codec> {
        let has_target = self.options.effort.target_db().is_some();
        match (self.options.target, self.role) {
            (Target::Portable, _) => Some(Codec::Passed),
            (Target::Desktop, Role::Color | Role::Data) if has_target => Some(Codec::Transcoded),
            _ => None,
        }
    }

    /// Stores the level's own blocks, if there are any that show its texels; whether that was done.
    pub(super) fn pass_level(&mut self) -> bool {
        let level = self.levels.len();
        let given = self.universal.and_then(|given| given.levels.get(level));
        let (Some(codec), Some(given)) = (self.passing(), given) else {
            return false;
        };
        match self.passed(codec, given) {
            Ok((blocks, error)) => {
                if level == 0 {
                    self.take_first(codec);
                }
                if let Some(grid) = self.mask() {
                    let alpha = bc::decode_alpha(self.format(), &blocks, grid.width, grid.height);
                    self.coverages.push(grid.coverage(&alpha));
                }
                self.store(blocks, error);
                true
            }
            Err(altered) => {
                self.altered_levels.extend(altered);
                // Normals of all levels lie in the channels of the first, and an encoder is chosen once.
                let once = self.role == Role::Normal && !self.is_pair();
                if level == 0 && (once || codec == Codec::Transcoded) {
                    self.universal = None;
                }
                false
            }
        }
    }

    fn is_pair(&self) -> bool {
        self.universal.is_some_and(|given| given.pair)
    }

    /// Level 0 is the file's: what has to be encoded below it lies in the same channels. Where a PSNR is asked for, masks
    /// are encoded at the least loss, other levels as the first of them decides.
    fn take_first(&mut self, codec: Codec) {
        self.first = Some(codec);
        let allowed = Codec::allowed(self.role, self.options);
        self.codec = allowed.last().copied().unwrap_or(self.codec);
        if self.role == Role::Normal && !self.is_pair() {
            self.places = [0, 1];
        }
    }

    /// The blocks to store of those that the file has, and their error; or why they cannot be, where they might have
    /// been.
    fn passed(
        &self,
        codec: Codec,
        given: &[u8],
    ) -> Result<(Vec<u8>, error::LevelError), Option<Altered>> {
        let reason = |altered| (codec == Codec::Passed).then_some(altered);
        let first = self.levels.is_empty();
        if first && self.altered {
            return Err(reason(Altered::Bled));
        }
        if !first && !self.options.plain_alpha && self.covers_otherwise() {
            return Err(reason(Altered::Coverage));
        }
        if codec == Codec::Transcoded {
            return self.transcoded(given).ok_or(None);
        }
        let mut error = error::LevelError::none(self.role);
        if self.role == Role::Normal {
            let places = match self.is_pair() {
                true => self.places,
                false => [0, 1],
            };
            error.angle_deg = self.measure_at(given, None, places).angle_deg;
            if error.angle_deg.is_some_and(|angle| angle.p99 > MOST_ANGLE) {
                return Err(reason(Altered::NotUnit));
            }
        }
        Ok((given.to_vec(), error))
    }

    /// Whether the alpha test passes another share of the level than of the source.
    fn covers_otherwise(&self) -> bool {
        self.mask().is_some_and(|grid| {
            let alpha: Vec<u8> = self.alpha().into_iter().map(unorm8).collect();
            (grid.coverage(&alpha) - self.coverage).abs() > MOST_COVERAGE
        })
    }

    /// The level as BC7, and its error, if that is what is asked for.
    fn transcoded(&self, given: &[u8]) -> Option<(Vec<u8>, error::LevelError)> {
        let blocks = given.as_chunks::<16>().0.par_iter();
        let blocks: Option<Vec<[u8; 16]>> = blocks.map(bc7::transcode_uastc_to_bc7).collect();
        let blocks = blocks?.into_flattened();
        let error = self.measure(&blocks, None);
        let target = self.options.effort.target_db();
        let reached = target.is_none_or(|target| error.psnr_db >= target);
        (reached || !self.levels.is_empty()).then_some((blocks, error))
    }
}
