//! Denoising: pictures come nearer to the converged one by it, references are left alone.

use super::*;

fn denoising() -> Settings {
    let mut settings = traced();
    settings.path.denoise = true;
    settings
}

/// A sphere on a plane under a sky of one bright side.
fn scene() -> Fixture {
    let mut sky = [[0.1; 3]; 6];
    sky[0] = [4.0; 3];
    Fixture {
        objects: vec![wide(0, 8.0), sphere(1, vec![Mat4::IDENTITY])],
        materials: vec![white(0.0, 0.9), white(0.0, 0.5)],
        environment: Some(sky),
        lut: true,
        ..Fixture::default()
    }
}

#[test]
fn a_reference_is_never_denoised() {
    let Some(gpu) = device() else { return };
    let shoot = |settings| {
        trace(
            &gpu,
            &scene(),
            [16, 16],
            at_angle(40.0),
            settings,
            &samples(4),
        )
    };
    let (plain, asked) = (shoot(traced()), shoot(denoising()));
    assert_eq!((plain.hdr, plain.rgba8), (asked.hdr, asked.rgba8));
    assert_eq!(asked.denoise_ms, None);
}

#[cfg(feature = "oidn")]
#[test]
fn denoised_pictures_are_nearer_to_the_converged_one() {
    use crate::headless::render_traced;
    let test = "denoised_pictures_are_nearer_to_the_converged_one";
    if crate::gpu::oidn::tests::denoiser(test).is_none() {
        return;
    }
    let Some(gpu) = device() else { return };
    let package = scene().package();
    let shoot = |settings, count| {
        let options = options([96, 96], at_angle(40.0), settings);
        render_traced(&package, &options, &samples(count)).expect("traces")
    };
    let truth = shoot(traced(), 1024);
    let (noisy, denoised) = (shoot(traced(), 2), shoot(denoising(), 2));
    assert!(noisy.denoise_ms.is_none() && denoised.denoise_ms.is_some());
    assert!(denoised.guides.is_none(), "they were not asked for");
    assert_eq!(denoised.non_finite(), Some(0));
    let rmse = |image: &HeadlessImage| {
        let [found, expected] = [image, &truth].map(|image| image.hdr.as_ref().expect("radiance"));
        let squares = found
            .iter()
            .zip(expected)
            .map(|(a, b)| f64::from(a[1] - b[1]).powi(2));
        (squares.sum::<f64>() / expected.len() as f64).sqrt()
    };
    let (before, after) = (rmse(&noisy), rmse(&denoised));
    eprintln!(
        "RMSE {before:.5} -> {after:.5} in {:?} ms",
        denoised.denoise_ms
    );
    assert!(after < 0.6 * before, "{before} -> {after}");
    assert_close(mean(&denoised, 1), mean(&truth, 1), 0.02);
    // The bytes are those of the denoised radiance: tonemapped on the GPU they would differ by dithering alone.
    let picture =
        crate::metrics::Picture::from_rgba(96, 96, denoised.hdr.as_ref().expect("radiance"));
    let shown = crate::metrics::display::display(&picture, &denoising()).to_srgb8();
    assert_eq!(denoised.rgba8, shown);
    assert_eq!(gpu.close(), Vec::<String>::new());
}
