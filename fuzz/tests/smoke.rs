//! Each target on every seed, then on a fixed sequence of mutants: nothing panics, and both ends are reached.

use std::path::Path;
use std::time::Instant;

use cairn_fuzz::mutate::{Random, dictionary, mutant};
use cairn_fuzz::{Target, Verdict, root};

/// Mutants of each target that goes through a file; those in memory are fed ten times as many.
const MUTANTS: usize = 2000;

/// `CAIRN_FUZZ_MUTANTS` asks for more.
fn mutants(target: Target) -> usize {
    let count = std::env::var("CAIRN_FUZZ_MUTANTS")
        .ok()
        .and_then(|count| count.parse().ok())
        .unwrap_or(MUTANTS);
    match target {
        Target::Image | Target::Package => 10 * count,
        _ => count,
    }
}

fn collect(folder: &Path, seeds: &mut Vec<Vec<u8>>) {
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("an entry").path())
        .collect();
    paths.sort();
    seeds.extend(
        paths
            .iter()
            .map(|path| std::fs::read(path).expect("a seed")),
    );
}

fn seeds(target: Target) -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    if target == Target::Package {
        collect(&root().join("../format/tests/golden"), &mut seeds);
    } else {
        collect(&root().join("seeds").join(target.name()), &mut seeds);
    }
    seeds
}

fn smoke(target: Target) {
    let start = Instant::now();
    let seeds = seeds(target);
    let accepted = seeds
        .iter()
        .filter(|seed| target.run(seed) == Verdict::Accepted);
    assert!(
        accepted.count() > 0,
        "{}: no seed is accepted",
        target.name()
    );
    let path = root().join(format!("dictionaries/{}.dict", target.name()));
    let words = dictionary(&std::fs::read_to_string(&path).expect("a dictionary"));
    assert!(words.len() > 5, "{}", path.display());
    let mut random = Random::new(0x5eed);
    let count = mutants(target);
    let accepted = (0..count)
        .filter(|_| target.run(&mutant(&seeds, &words, &mut random)) == Verdict::Accepted)
        .count();
    println!(
        "{}: {} seeds, {count} mutants, {accepted} accepted, {:.0} a second",
        target.name(),
        seeds.len(),
        count as f64 / start.elapsed().as_secs_f64()
    );
    assert!(accepted > 0 && accepted < count, "{accepted} of {count}");
}

#[test]
fn gltf() {
    smoke(Target::Gltf);
}

#[test]
fn glb() {
    smoke(Target::Glb);
}

#[test]
fn images() {
    smoke(Target::Image);
}

#[test]
fn panoramas() {
    smoke(Target::Panorama);
}

#[test]
fn packages() {
    smoke(Target::Package);
}
