//! Chooses which two texture coordinate sets of a primitive become `uv0` and `uv1`.

use std::collections::BTreeSet;

use crate::diagnostic::Result;

use super::context::Context;
use super::material;

/// The `TEXCOORD_n` behind `uv0` and `uv1`. A function of the material alone, so that primitives
/// of one material agree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UvSets {
    pub sets: [Option<u32>; 2],
    /// Number of distinct sets beyond the second, which read `uv0`.
    pub surplus: usize,
}

impl UvSets {
    const CORE: Self = Self {
        sets: [Some(0), Some(1)],
        surplus: 0,
    };

    /// The sets that the textures of a material use; sets 0 and 1 keep their numbers.
    ///
    /// # Errors
    /// A malformed texture transform of the material.
    pub fn of(context: &Context, material: Option<u32>) -> Result<Self> {
        let Some(material) = material else {
            return Ok(Self::CORE);
        };
        let slots = material::texture_slots(context, material)?;
        Ok(Self::mapping(
            slots.iter().flatten().map(|slot| slot.uv_set),
        ))
    }

    fn mapping(used: impl Iterator<Item = u32>) -> Self {
        let used: BTreeSet<u32> = used.collect();
        if used.iter().all(|&set| set < 2) {
            return Self::CORE;
        }
        let mut ascending = used.iter().copied();
        Self {
            sets: [ascending.next(), ascending.next()],
            surplus: ascending.count(),
        }
    }

    /// 0 or 1 for `uv0` or `uv1`; sets beyond the second read `uv0`.
    pub fn slot(&self, set: u32) -> u32 {
        u32::from(self.sets[0] != Some(set) && self.sets[1] == Some(set))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_map_in_ascending_order() {
        let mapped = |used: &[u32]| {
            let sets = UvSets::mapping(used.iter().copied());
            let slots: Vec<u32> = used.iter().map(|&set| sets.slot(set)).collect();
            (sets.sets, sets.surplus, slots)
        };
        let core = [Some(0), Some(1)];
        assert_eq!(mapped(&[]), (core, 0, vec![]));
        assert_eq!(mapped(&[1]), (core, 0, vec![1]));
        assert_eq!(mapped(&[1, 0, 1]), (core, 0, vec![1, 0, 1]));
        assert_eq!(mapped(&[3]), ([Some(3), None], 0, vec![0]));
        assert_eq!(mapped(&[4, 1]), ([Some(1), Some(4)], 0, vec![1, 0]));
        assert_eq!(mapped(&[0, 7]), ([Some(0), Some(7)], 0, vec![0, 1]));
        let three = mapped(&[5, 2, 9, 2]);
        assert_eq!(three, ([Some(2), Some(5)], 1, vec![1, 0, 0, 0]));
    }
}
