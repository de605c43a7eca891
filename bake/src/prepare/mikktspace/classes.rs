//! Classes of corners that compare equal in position, normal and texture coordinate.

use super::{Corners, NONE};

/// Corners that are looked up together, so that their cache misses overlap.
const BATCH: usize = 32;

const EMPTY: u64 = u64::MAX;

/// The classes, numbered by first appearance.
pub(super) struct Classes {
    /// Class of each corner.
    pub(super) of: Vec<u32>,
    /// First corner of each class.
    pub(super) first: Vec<u32>,
}

impl Classes {
    pub(super) fn count(&self) -> usize {
        self.first.len()
    }

    /// Renumbers so that every corner of `loose`, which may be in any order, has a class of its own.
    pub(super) fn separate(&mut self, loose: &[u32]) {
        let mut alone = vec![false; self.of.len()];
        for corner in loose {
            alone[*corner as usize] = true;
        }
        let mut renumbered = vec![NONE; self.first.len()];
        self.first.clear();
        for (corner, class) in self.of.iter_mut().enumerate() {
            let known = renumbered[*class as usize];
            if known != NONE && !alone[corner] {
                *class = known;
                continue;
            }
            let number = self.first.len() as u32;
            self.first.push(corner as u32);
            if !alone[corner] {
                renumbered[*class as usize] = number;
            }
            *class = number;
        }
    }
}

type Key = [u32; 8];

/// Finds the classes with an open-addressing table whose slots hold 32 bits of hash and a class.
struct Table {
    slots: Vec<u64>,
    /// Right shift that makes a hash a slot.
    shift: u32,
    keys: Vec<Key>,
}

pub(super) fn classes<C: Corners + ?Sized>(corners: &C) -> Classes {
    let count = corners.count();
    let mut table = Table::new(count);
    let mut of = Vec::with_capacity(count);
    let mut first = Vec::with_capacity(count / 6);
    let mut keys = [[0; 8]; BATCH];
    let mut hashes = [0u32; BATCH];
    for start in (0..count).step_by(BATCH) {
        let batch = BATCH.min(count - start);
        table.reserve(batch);
        for at in 0..batch {
            keys[at] = key(corners, start + at);
            hashes[at] = hash(&keys[at]);
        }
        table.touch(&hashes[..batch]);
        for at in 0..batch {
            let class = table.find(&keys[at], hashes[at]);
            if class as usize == first.len() {
                first.push((start + at) as u32);
            }
            of.push(class);
        }
    }
    Classes { of, first }
}

/// Bits that are equal where the floats are; the sum makes both zeros one.
#[inline(always)]
fn key<C: Corners + ?Sized>(corners: &C, corner: usize) -> Key {
    let bits = |value: f32| (value + 0.0).to_bits();
    let [x, y, z] = corners.position(corner).map(bits);
    let [nx, ny, nz] = corners.normal(corner).map(bits);
    let [u, v] = corners.uv(corner).map(bits);
    [x, y, z, nx, ny, nz, u, v]
}

#[inline(always)]
fn hash(key: &Key) -> u32 {
    let word = |at: usize| u64::from(key[at]) | (u64::from(key[at + 1]) << 32);
    let fold = |a: u64, b: u64| {
        let product = u128::from(a) * u128::from(b);
        (product as u64) ^ ((product >> 64) as u64)
    };
    let a = fold(
        word(0) ^ 0x9E37_79B9_7F4A_7C15,
        word(2) ^ 0xC2B2_AE3D_27D4_EB4F,
    );
    let b = fold(
        word(4) ^ 0x1656_67B1_9E37_79F9,
        word(6) ^ 0xA076_1D64_78BD_642F,
    );
    (fold(a ^ 0xE703_7ED1_A0B4_28DB, b ^ 0x8EBC_6AF0_9C88_C6E3) >> 32) as u32
}

#[inline(always)]
fn has_nan(key: &Key) -> bool {
    key.iter().any(|bits| bits << 1 > 0xFF00_0000)
}

impl Table {
    /// A table for the classes of a closed mesh with `corners` corners, which has a sixth as many vertices.
    fn new(corners: usize) -> Self {
        let bits = (corners / 4).max(4).next_power_of_two().ilog2();
        Self {
            slots: vec![EMPTY; 1 << bits],
            shift: 32 - bits,
            keys: Vec::with_capacity(corners / 6),
        }
    }

    /// Makes room for `more` classes.
    fn reserve(&mut self, more: usize) {
        while (self.keys.len() + more) * 2 > self.slots.len() && self.shift > 0 {
            let old = std::mem::take(&mut self.slots);
            self.slots = vec![EMPTY; old.len() * 2];
            self.shift -= 1;
            for entry in old.into_iter().filter(|entry| *entry != EMPTY) {
                let mut slot = self.home((entry >> 32) as u32);
                while self.slots[slot] != EMPTY {
                    slot = (slot + 1) & (self.slots.len() - 1);
                }
                self.slots[slot] = entry;
            }
        }
    }

    #[inline(always)]
    fn home(&self, hash: u32) -> usize {
        (hash >> self.shift) as usize
    }

    /// Loads what [`Self::find`] is going to read, with all loads in flight at once.
    #[inline(always)]
    fn touch(&self, hashes: &[u32]) {
        let mut sum = 0;
        for hash in hashes {
            let entry = self.slots[self.home(*hash)];
            let key = self.keys.get(entry as u32 as usize);
            sum ^= key.map_or(0, |key| key[0]);
        }
        std::hint::black_box(sum);
    }

    /// Class of `key`, a new one where it is unknown.
    #[inline(always)]
    fn find(&mut self, key: &Key, hash: u32) -> u32 {
        let next = self.keys.len() as u32;
        let mask = self.slots.len() - 1;
        let mut slot = self.home(hash);
        loop {
            let entry = self.slots[slot];
            if entry == EMPTY {
                break;
            }
            if (entry >> 32) as u32 == hash && self.keys[entry as u32 as usize] == *key {
                return entry as u32;
            }
            slot = (slot + 1) & mask;
        }
        // NaN equals nothing, not even itself; such keys stay out of the table.
        if !has_nan(key) {
            self.slots[slot] = (u64::from(hash) << 32) | u64::from(next);
        }
        self.keys.push(*key);
        next
    }
}
