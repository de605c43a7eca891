//! Exact welding: equal values get one number, in order of first appearance.

use std::hash::{BuildHasher, Hash, Hasher, RandomState};

const EMPTY: u32 = u32::MAX;

/// A set that numbers its values as they come.
///
/// Slots hold numbers only, so the table costs 8 bytes a value at most. The hash is keyed at random: no input can
/// be made to collide, and the order of the slots never shows.
pub(super) struct Welder<T> {
    slots: Vec<u32>,
    values: Vec<T>,
    keys: Keys,
}

impl<T: Copy + Eq + Hash> Welder<T> {
    /// An empty set that takes `count` values without growing.
    pub(super) fn with_capacity(count: usize) -> Self {
        Self {
            slots: vec![EMPTY; (count * 2 + 2).next_power_of_two().max(64)],
            values: Vec::with_capacity(count),
            keys: Keys::random(),
        }
    }

    /// The value with a number that [`Self::add`] gave.
    pub(super) fn value(&self, number: u32) -> &T {
        &self.values[number as usize]
    }

    /// The number of `value`. At most `u32::MAX` different values may be added.
    pub(super) fn add(&mut self, value: T) -> u32 {
        if self.values.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let slot = self.slot(&value);
        if self.slots[slot] == EMPTY {
            self.slots[slot] = self.values.len() as u32;
            self.values.push(value);
        }
        self.slots[slot]
    }

    /// The values, each at its number.
    pub(super) fn into_values(self) -> Vec<T> {
        self.values
    }

    /// The slot that holds `value`, or the empty one where it belongs.
    fn slot(&self, value: &T) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = self.keys.hash_one(value) as usize & mask;
        while self.slots[slot] != EMPTY && self.values[self.slots[slot] as usize] != *value {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn grow(&mut self) {
        self.slots = vec![EMPTY; self.slots.len() * 2];
        for number in 0..self.values.len() {
            let slot = self.slot(&self.values[number]);
            self.slots[slot] = number as u32;
        }
    }
}

/// Keys of the hash.
#[derive(Clone, Copy)]
struct Keys([u64; 2]);

impl Keys {
    fn random() -> Self {
        let seed = RandomState::new();
        Self([0u64, 1].map(|which| seed.hash_one(which)))
    }
}

impl BuildHasher for Keys {
    type Hasher = Folded;

    fn build_hasher(&self) -> Folded {
        Folded {
            state: self.0[0],
            keys: *self,
        }
    }
}

/// A hash of whole records by folded multiplication: 64 x 64 bits to 128, halves xored.
struct Folded {
    state: u64,
    keys: Keys,
}

impl Folded {
    fn mix(&mut self, a: u64, b: u64) {
        let [first, second] = self.keys.0;
        let product = u128::from(self.state ^ a ^ first) * u128::from(b ^ second);
        self.state = (self.state.rotate_left(23) ^ product as u64) ^ (product >> 64) as u64;
    }
}

impl Hasher for Folded {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(16) {
            let mut block = [0; 16];
            block[..chunk.len()].copy_from_slice(chunk);
            let block = u128::from_le_bytes(block);
            self.mix(block as u64, (block >> 64) as u64);
        }
    }

    fn write_usize(&mut self, _length: usize) {
        // Only the lengths of arrays come here, and a set holds arrays of one length.
    }

    fn finish(&self) -> u64 {
        let product = u128::from(self.state) * 0x9E37_79B9_7F4A_7C15;
        product as u64 ^ (product >> 64) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn numbers_follow_first_appearance(values in prop::collection::vec(0u32..300, 0..2000)) {
            let mut welder = Welder::with_capacity(0);
            let numbers: Vec<u32> = values.iter().map(|value| welder.add(*value)).collect();
            let mut expected = BTreeMap::new();
            for (value, number) in values.iter().zip(&numbers) {
                let next = expected.len() as u32;
                prop_assert_eq!(*expected.entry(*value).or_insert(next), *number);
            }
            let stored = welder.into_values();
            prop_assert_eq!(stored.len(), expected.len());
            for (value, number) in values.iter().zip(&numbers) {
                prop_assert_eq!(stored[*number as usize], *value);
            }
        }
    }

    #[test]
    fn hashes_of_neighbours_scatter() {
        let keys = Keys::random();
        let grid = (0..1u32 << 14).map(|index| {
            let mut record = [0u32; 14];
            (record[0], record[1]) = (((index & 127) as f32).to_bits(), (index >> 7) << 20);
            keys.hash_one(record) as usize & 0xFFFF
        });
        let distinct: std::collections::BTreeSet<usize> = grid.collect();
        // Of 2^14 balls in 2^16 bins, 14497 bins are hit on average, give or take 41.
        assert!(distinct.len() > 14_000, "{}", distinct.len());
    }

    #[test]
    fn values_that_differ_in_one_bit_stay_apart() {
        let mut welder = Welder::with_capacity(0);
        let base = [0u32; 14];
        assert_eq!(welder.add(base), 0);
        for bit in 0..14 * 32 {
            let mut value = base;
            value[bit / 32] = 1 << (bit % 32);
            assert_eq!(welder.add(value), bit as u32 + 1);
        }
        assert_eq!(welder.add(base), 0);
    }
}
