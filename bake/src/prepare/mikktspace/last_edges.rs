//! The edges that the reference leaves in a pseudo-random order.
//!
//! Its quicksort of edges never sorts the last run of equal first ends by their second ends, so that equal edges
//! in it may lie apart and stay unpaired. The last run starts at the largest representative that is the smaller
//! end of any edge; where it holds anything to pair, its order must be replayed.

use super::classes::Classes;
use super::representatives::{Bounds, representatives};
use super::twins::{Edge, Edges, after, pair_adjacent};
use super::{Corners, flag};

const SEED: u32 = 39_871_946;

/// Pairs the last edges as the reference does.
pub(super) fn repair<C: Corners + ?Sized>(
    corners: &C,
    flags: &[u8],
    classes: &Classes,
    bounds: Bounds,
    edges: &Edges,
    twins: &mut [u32],
) {
    let Some(mut last) = last_run(corners, flags, classes, bounds, edges) else {
        return;
    };
    if last.len() <= 2 || all_differ(&mut last) {
        return;
    }
    let order = replay(corners, flags, classes, bounds);
    pair_adjacent(&order, twins);
}

/// The other ends of the edges from the largest representative, in no order.
fn last_run<C: Corners + ?Sized>(
    corners: &C,
    flags: &[u8],
    classes: &Classes,
    bounds: Bounds,
    edges: &Edges,
) -> Option<Vec<u32>> {
    // A representative is no smaller than the first of its class, and the classes are numbered by their firsts.
    let least_class = (0..classes.count()).rfind(|class| !edges.of(*class).is_empty())?;
    let least = classes.first[least_class] as usize;
    let mut eligible = vec![false; classes.count()];
    for class in &classes.of[least..] {
        eligible[*class as usize] = true;
    }
    let mut candidates = Vec::new();
    let mut needed = vec![false; classes.count()];
    for class in (0..classes.count()).filter(|class| eligible[*class]) {
        for edge in edges
            .of(class)
            .iter()
            .filter(|edge| eligible[edge.other as usize])
        {
            candidates.push((class as u32, *edge));
            needed[class] = true;
            needed[edge.other as usize] = true;
        }
    }
    let found = representatives(corners, flags, classes, bounds, Some(&needed)).of;
    let key = |(class, edge): &(u32, Edge)| found[*class as usize].min(found[edge.other as usize]);
    let largest = candidates.iter().map(key).max()?;
    let pivot = classes.of[largest as usize];
    let last = candidates
        .iter()
        .filter(|candidate| key(candidate) == largest);
    Some(
        last.map(|(class, edge)| class ^ edge.other ^ pivot)
            .collect(),
    )
}

fn all_differ(ends: &mut [u32]) -> bool {
    ends.sort_unstable();
    ends.windows(2).all(|pair| pair[0] != pair[1])
}

#[derive(Clone, Copy)]
struct Keyed {
    key: u32,
    half: u32,
}

/// The last edges in the order in which the reference leaves them.
fn replay<C: Corners + ?Sized>(
    corners: &C,
    flags: &[u8],
    classes: &Classes,
    bounds: Bounds,
) -> Vec<Edge> {
    let found = representatives(corners, flags, classes, bounds, None).of;
    let of = |corner: u32| classes.of[corner as usize];
    let mut keyed = Vec::new();
    let sound = flags.iter().enumerate();
    for (triangle, _) in sound.filter(|(_, flags)| *flags & flag::DEGENERATE == 0) {
        for half in (triangle * 3) as u32..(triangle * 3 + 3) as u32 {
            let (a, b) = (of(half), of(after(half)));
            let key = found[a as usize].min(found[b as usize]);
            keyed.push(Keyed { key, half });
        }
    }
    let Some(largest) = keyed.iter().map(|edge| edge.key).max() else {
        return Vec::new();
    };
    sort_last(&mut keyed, |edge| edge.key, largest);
    let pivot = of(largest);
    let last = keyed.iter().rev().take_while(|edge| edge.key == largest);
    let mut order: Vec<Edge> = last
        .map(|edge| {
            let other = of(edge.half) ^ of(after(edge.half)) ^ pivot;
            Edge::directed(edge.half, other, of(edge.half) != pivot)
        })
        .collect();
    order.reverse();
    // Sorting runs of equal edges by triangle needs no replay, but the last of them is left out.
    let mut runs: Vec<&mut [Edge]> = order.chunk_by_mut(|a, b| a.other == b.other).collect();
    runs.pop();
    for run in runs {
        run.sort_unstable_by_key(|edge| edge.half());
    }
    order
}

/// The reference's quicksort, as far as the items of the `largest` key take part.
fn sort_last<T>(items: &mut [T], key: impl Fn(&T) -> u32, largest: u32) {
    let mut stack = vec![(0, items.len(), SEED)];
    while let Some((start, end, seed)) = stack.pop() {
        let part = &mut items[start..end];
        if part.len() <= 2 {
            part.sort_by_key(&key);
            continue;
        }
        let turn = seed & 31;
        let seed = seed.wrapping_add(seed.rotate_left(turn)).wrapping_add(3);
        let pivot = key(&part[(seed as usize) % part.len()]);
        let (mut a, mut b) = (0, part.len() - 1);
        while a <= b {
            while key(&part[a]) < pivot {
                a += 1;
            }
            while key(&part[b]) > pivot {
                b -= 1;
            }
            if a <= b {
                part.swap(a, b);
                a += 1;
                b = b.saturating_sub(1);
            }
        }
        if pivot == largest {
            stack.push((start, start + b + 1, seed));
        }
        stack.push((start + a, end, seed));
    }
}
