//! The sampler: its constants, and the error of images against the number of samples.

use glam::{Mat4, Vec3};

use super::super::fixture::{Fixture, sphere};
use super::super::{device, towards_origin};
use super::{samples, trace, traced, white, wide};
use crate::headless::HeadlessImage;
use crate::settings::PathSampler;

/// Direction numbers of a primitive polynomial (without its leading bit, highest coefficient first) by the recurrence
/// of Bratley and Fox 1988.
fn directions(polynomial: &[bool], initial: &[u32]) -> [u32; 32] {
    let degree = initial.len();
    let mut numbers = [0; 32];
    for (bit, number) in initial.iter().enumerate() {
        numbers[bit] = number << (31 - bit);
    }
    for bit in degree..32 {
        let mut next = numbers[bit - degree] ^ (numbers[bit - degree] >> degree);
        for (term, coefficient) in polynomial.iter().enumerate() {
            if *coefficient {
                next ^= numbers[bit - term - 1];
            }
        }
        numbers[bit] = next;
    }
    numbers
}

#[test]
fn direction_numbers_follow_the_recurrence() {
    let source = include_str!("../../../../../shaders/pathtrace/sampler.glsl");
    for (name, polynomial, initial) in [
        ("SOBOL_THIRD", &[true][..], &[1, 1][..]),
        ("SOBOL_FOURTH", &[true, false], &[1, 1, 5]),
    ] {
        let start = source.find(&format!("{name}[32] =")).expect("the table");
        let body = &source[start..source[start..].find(';').expect("its end") + start];
        let found: Vec<u32> = body
            .split("0x")
            .skip(1)
            .map(|text| u32::from_str_radix(&text[..8], 16).expect("hexadecimal"))
            .collect();
        assert_eq!(found, directions(polynomial, initial), "{name}");
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

fn shoot(gpu: &crate::gpu::Gpu, sampler: PathSampler, seed: u32, count: u32) -> HeadlessImage {
    let mut settings = traced();
    settings.path.sampler = sampler;
    settings.path.seed = seed;
    settings.path.bounces = 1;
    let camera = towards_origin(Vec3::new(0.6, -1.2, 2.6));
    trace(gpu, &soft(), [16, 16], camera, settings, &samples(count))
}

fn rmse(image: &HeadlessImage, reference: &HeadlessImage) -> f64 {
    let texels = |image: &HeadlessImage| image.hdr.clone().expect("read back");
    let (a, b) = (texels(image), texels(reference));
    let sum: f64 = a
        .iter()
        .zip(&b)
        .map(|(a, b)| f64::from(a[1] - b[1]).powi(2))
        .sum();
    (sum / a.len() as f64).sqrt()
}

/// Halves the error of random numbers at equal samples, and falls faster.
#[test]
fn error_falls_faster_than_that_of_random_numbers() {
    let Some(gpu) = device() else { return };
    let reference = shoot(&gpu, PathSampler::Owen, 77, 4096);
    let error = |sampler, count| {
        let runs = if count < 64 { 3 } else { 1 };
        let sum: f64 = (0..runs)
            .map(|seed| rmse(&shoot(&gpu, sampler, seed, count), &reference).powi(2))
            .sum();
        (sum / f64::from(runs)).sqrt()
    };
    let counts = [4u32, 32, 256, 1024];
    let owen = counts.map(|count| error(PathSampler::Owen, count));
    let random = counts.map(|count| error(PathSampler::Independent, count));
    let slope = (owen[3] / owen[0]).ln() / 256f64.ln();
    println!("owen {owen:?}\nrandom {random:?}\nslope {slope}");
    assert!(slope <= -0.6, "slope {slope}: {owen:?}");
    for (owen, random) in owen.iter().zip(&random).skip(1) {
        assert!(owen * 2.0 <= *random, "{owen} against {random}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Neighbouring pixels err against each other: averaged over 2x2 pixels, one sample's error falls further than that
/// of random numbers.
#[test]
fn few_samples_err_at_high_frequency() {
    let Some(gpu) = device() else { return };
    let reference = shoot(&gpu, PathSampler::Owen, 77, 4096);
    let blurred = |sampler| {
        let mut sum = 0.0;
        for seed in 0..4 {
            let image = shoot(&gpu, sampler, seed, 1);
            let texels = |image: &HeadlessImage| image.hdr.clone().expect("read back");
            let (a, b) = (texels(&image), texels(&reference));
            let error: Vec<f64> = a
                .iter()
                .zip(&b)
                .map(|(a, b)| f64::from(a[1] - b[1]))
                .collect();
            for block in 0..64usize {
                let (x, y) = (block % 8 * 2, block / 8 * 2);
                let total: f64 = [0, 1, 16, 17]
                    .iter()
                    .map(|step| error[y * 16 + x + step])
                    .sum();
                sum += (total / 4.0).powi(2);
            }
        }
        (sum / 256.0).sqrt()
    };
    let (owen, random) = (
        blurred(PathSampler::Owen),
        blurred(PathSampler::Independent),
    );
    println!("2x2 blurred, one sample: owen {owen}, random {random}");
    assert!(owen * 1.25 <= random, "{owen} against {random}");
    assert_eq!(gpu.close(), Vec::<String>::new());
}
