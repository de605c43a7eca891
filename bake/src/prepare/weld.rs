//! Exact welding: equal values get one number, in order of first appearance.

use std::hash::{BuildHasher, Hash, RandomState};

const EMPTY: u32 = u32::MAX;

/// A set that numbers its values as they come.
///
/// Slots hold numbers only, so the table costs 8 bytes a value at most. The hash is keyed at random: no input can
/// be made to collide, and the order of the slots never shows.
pub(super) struct Welder<T> {
    slots: Vec<u32>,
    values: Vec<T>,
    hasher: RandomState,
}

impl<T: Copy + Eq + Hash> Welder<T> {
    /// An empty set.
    pub(super) fn new() -> Self {
        Self {
            slots: vec![EMPTY; 64],
            values: Vec::new(),
            hasher: RandomState::new(),
        }
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
        let mut slot = self.hasher.hash_one(value) as usize & mask;
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn numbers_follow_first_appearance(values in prop::collection::vec(0u32..300, 0..2000)) {
            let mut welder = Welder::new();
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
    fn values_that_differ_in_one_bit_stay_apart() {
        let mut welder = Welder::new();
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
