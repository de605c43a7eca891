//! The sampler: its constants, and the error of images against the number of samples.

use glam::{Mat4, Vec3};

use super::super::fixture::{Fixture, sphere};
use super::super::{device, options, towards_origin};
use super::{traced, white, wide};
use crate::gpu::Gpu;
use crate::headless::trace::trace_seeds;
use crate::settings::PathSampler;

/// The shader's table: what each bit of a pixel's x and y adds to both coordinates.
fn tile_shifts() -> Vec<[u32; 2]> {
    let source = include_str!("../../../../../shaders/pathtrace/sampler.glsl");
    let start = source
        .find("TILE_SHIFTS[2 * TILE_BITS] =")
        .expect("the table");
    let body = &source[start..source[start..].find(';').expect("its end") + start];
    let words: Vec<u32> = body
        .split("0x")
        .skip(1)
        .map(|text| u32::from_str_radix(&text[..8], 16).expect("hexadecimal"))
        .collect();
    words.as_chunks::<2>().0.to_vec()
}

/// Rank over GF(2).
fn rank(mut rows: Vec<u32>) -> usize {
    let mut rank = 0;
    while let Some(row) = rows.pop() {
        if row != 0 {
            rank += 1;
            let lowest = row & row.wrapping_neg();
            for other in &mut rows {
                if *other & lowest != 0 {
                    *other ^= row;
                }
            }
        }
    }
    rank
}

/// The first 2^k points of a pixel with those of its neighbours in an aligned square are a net of quality 1: t of
/// Niederreiter 1987, from the ranks of the generator matrices' leading rows. In one pair of cases it is 2.
#[test]
fn neighbours_fill_each_others_gaps() {
    let shifts = tile_shifts();
    assert_eq!(shifts.len(), 8);
    let own = |coordinate: usize, digit: u32, bit: u32| match coordinate {
        0 => digit == bit,
        _ => digit & bit == digit,
    };
    for samples in 0..=6u32 {
        for pixels in [2usize, 4, 6, 8] {
            let digits = samples + pixels as u32;
            let row = |coordinate: usize, digit: u32| {
                let own = (0..samples).map(|bit| u32::from(own(coordinate, digit, bit)) << bit);
                let of_pixel = shifts[..pixels].iter().enumerate().map(|(bit, shift)| {
                    (shift[coordinate] >> (31 - digit) & 1) << (samples + bit as u32)
                });
                own.chain(of_pixel).fold(0, |row, bit| row | bit)
            };
            let worst = (0..=digits).map(|first| {
                let rows = (0..first).map(|digit| row(0, digit));
                let rows = rows.chain((0..digits - first).map(|digit| row(1, digit)));
                digits as usize - rank(rows.collect())
            });
            let allowed = if (samples, pixels) == (6, 2) { 2 } else { 1 };
            let worst = worst.max().expect("a split");
            assert!(
                worst <= allowed,
                "2^{samples} samples, 2^{pixels} pixels: {worst}"
            );
        }
    }
}

/// A wide floor under a soft sky, shaded by a sphere that stands out of the picture.
fn soft() -> Fixture {
    let sphere_model = Mat4::from_translation(Vec3::new(0.0, 2.4, 1.2));
    Fixture {
        objects: vec![sphere(0, vec![sphere_model]), wide(0, 9.0)],
        materials: vec![white(0.0, 0.9)],
        environment: Some([[1.0; 3]; 6]),
        gradient: Some(|d| [0.6 + 0.5 * d.y + 0.3 * d.x; 3]),
        lut: true,
        ..Fixture::default()
    }
}

/// Pixels a side of the pictures whose error is measured, and of those whose error has its frequencies measured.
const SIDE: u32 = 16;
const WIDE: u32 = 32;

/// Green of the soft scene with each of these seeds.
fn shoot(gpu: &Gpu, sampler: PathSampler, seeds: &[u32], count: u32, side: u32) -> Vec<Vec<f64>> {
    let mut settings = traced();
    settings.path.sampler = sampler;
    settings.path.bounces = 1;
    let camera = towards_origin(Vec3::new(0.6, -1.2, 2.6));
    let options = options([side; 2], camera, settings);
    let pictures = trace_seeds(gpu, &soft().package(), &options, count, seeds).expect("traces");
    let green = |texels: &Vec<[f32; 4]>| texels.iter().map(|texel| f64::from(texel[1])).collect();
    pictures.iter().map(green).collect()
}

fn rmse(pictures: &[Vec<f64>], reference: &[f64]) -> f64 {
    let squares = pictures.iter().flat_map(|picture| {
        let pairs = picture.iter().zip(reference);
        pairs.map(|(a, b)| (a - b).powi(2))
    });
    let count = (pictures.len() * reference.len()) as f64;
    (squares.sum::<f64>() / count).sqrt()
}

/// Halves the error of random numbers at equal samples, and falls faster.
#[test]
fn error_falls_faster_than_that_of_random_numbers() {
    let Some(gpu) = device() else { return };
    let reference = shoot(&gpu, PathSampler::Owen, &[77], 4096, SIDE).remove(0);
    let error = |sampler, count| {
        let seeds: &[u32] = if count < 64 { &[0, 1, 2] } else { &[0] };
        rmse(&shoot(&gpu, sampler, seeds, count, SIDE), &reference)
    };
    let counts = [4u32, 32, 256, 1024];
    let owen = counts.map(|count| error(PathSampler::BlueNoise, count));
    let random = counts.map(|count| error(PathSampler::Independent, count));
    let slope = (owen[3] / owen[0]).ln() / 256f64.ln();
    println!("owen {owen:?}\nrandom {random:?}\nslope {slope}");
    assert!(slope <= -0.6, "slope {slope}: {owen:?}");
    for (owen, random) in owen.iter().zip(&random).skip(1) {
        assert!(owen * 2.0 <= *random, "{owen} against {random}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Share of the error's power in the low quarter of frequencies, against its even share: 1 for white noise. Of `runs`
/// pictures of `count` samples, the error of each against the mean of all.
fn low_frequency_power(gpu: &Gpu, sampler: PathSampler, count: u32, runs: u32) -> f64 {
    const BLOCK: usize = 4;
    let seeds: Vec<u32> = (0..runs).collect();
    let images = shoot(gpu, sampler, &seeds, count, WIDE);
    let side = WIDE as usize;
    let (mut all, mut low) = (0.0, 0.0);
    for image in &images {
        let error: Vec<f64> = (0..side * side)
            .map(|at| {
                let mean: f64 = images.iter().map(|image| image[at]).sum::<f64>();
                image[at] - mean / f64::from(runs)
            })
            .collect();
        all += error.iter().map(|error| error * error).sum::<f64>() / (side * side) as f64;
        let blocks = side / BLOCK;
        for block in 0..blocks * blocks {
            let (x, y) = (block % blocks * BLOCK, block / blocks * BLOCK);
            let sum: f64 = (0..BLOCK * BLOCK)
                .map(|at| error[(y + at / BLOCK) * side + x + at % BLOCK])
                .sum();
            low += sum * sum / ((BLOCK * BLOCK) as f64 * (blocks * blocks) as f64);
        }
    }
    low / all
}

/// Neighbouring pixels err against each other: what is left over blocks of 4x4 pixels is half of what white noise
/// leaves there, at 1 and at 4 samples.
#[test]
fn few_samples_err_at_high_frequency() {
    let Some(gpu) = device() else { return };
    for count in [1, 4] {
        let [blue, owen] = [PathSampler::BlueNoise, PathSampler::Owen]
            .map(|sampler| low_frequency_power(&gpu, sampler, count, 6));
        println!("{count} samples: power at low frequency {blue} of even, owen {owen}");
        assert!(blue < 0.6, "{count} samples: {blue}");
        assert!((0.8..1.25).contains(&owen), "{count} samples: {owen}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}
