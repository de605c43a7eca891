//! An analytic clear sky with a sun as an equirectangular map.

use glam::DVec3;
use libm::{acos, cos, exp, sin, tan};

use crate::hdr;
use crate::noise::{fbm, mix3, smoothstep};

/// Texels across and down.
pub const SIZE: (usize, usize) = (512, 256);
/// Height of the sun above the horizon, in degrees.
pub const SUN_ELEVATION: f64 = 40.0;
/// Azimuth of the sun in degrees from +x towards +z.
pub const SUN_AZIMUTH: f64 = 57.0;
/// Angular radius of the sun's disc in degrees: the true 0.27 widened to a few texels.
pub const SUN_RADIUS: f64 = 1.2;
/// Ratio of the sun's to the sky's irradiance on level ground.
pub const SUN_TO_SKY: f64 = 3.6;
/// Mean radiance of the sky above the horizon, weighted by solid angle.
pub const MEAN_SKY: f64 = 0.36;

const TURBIDITY: f64 = 2.6;
const SUN_COLOR: [f64; 3] = [1.0, 0.88, 0.70];
const GROUND: [f64; 3] = [0.60, 0.53, 0.45];

/// Unit direction of texel (x, y): u = 0.5 + atan2(z, x) / 2pi, v = acos(y) / pi, so the image's middle is +x.
pub fn texel_direction(x: f64, y: f64) -> DVec3 {
    let phi = (x / SIZE.0 as f64 - 0.5) * std::f64::consts::TAU;
    let theta = y / SIZE.1 as f64 * std::f64::consts::PI;
    DVec3::new(sin(theta) * cos(phi), cos(theta), sin(theta) * sin(phi))
}

/// Solid angle of a texel of row `y`, in steradians.
pub fn texel_solid_angle(y: usize) -> f64 {
    let edge = |y: usize| cos(y as f64 / SIZE.1 as f64 * std::f64::consts::PI);
    (edge(y) - edge(y + 1)) * std::f64::consts::TAU / SIZE.0 as f64
}

/// Unit direction towards the sun.
pub fn sun_direction() -> DVec3 {
    let (elevation, azimuth) = (SUN_ELEVATION.to_radians(), SUN_AZIMUTH.to_radians());
    DVec3::new(
        cos(elevation) * cos(azimuth),
        sin(elevation),
        cos(elevation) * sin(azimuth),
    )
}

/// Perez' luminance distribution (Perez et al. 1993) with zenith angle cosine `c` and sun angle `gamma`.
fn perez(p: [f64; 5], c: f64, gamma: f64) -> f64 {
    let cg = cos(gamma);
    (1.0 + p[0] * exp(p[1] / c)) * (1.0 + p[2] * exp(p[3] * gamma) + p[4] * cg * cg)
}

/// Zenith chromaticity polynomial in turbidity and sun zenith angle.
fn zenith_chroma(rows: [[f64; 4]; 3], s: f64) -> f64 {
    let t = TURBIDITY;
    let row = |r: [f64; 4]| ((r[0] * s + r[1]) * s + r[2]) * s + r[3];
    (row(rows[0]) * t + row(rows[1])) * t + row(rows[2])
}

/// Linear sRGB radiance of the cloudless sky, unscaled, after Preetham, Shirley and Smits,
/// "A Practical Analytic Model for Daylight", SIGGRAPH 1999, appendix A.2.
fn clear_sky(direction: DVec3) -> [f64; 3] {
    let t = TURBIDITY;
    let lum = [
        0.1787 * t - 1.4630,
        -0.3554 * t + 0.4275,
        -0.0227 * t + 5.3251,
        0.1206 * t - 2.5771,
        -0.0670 * t + 0.3703,
    ];
    let cx = [
        -0.0193 * t - 0.2592,
        -0.0665 * t + 0.0008,
        -0.0004 * t + 0.2125,
        -0.0641 * t - 0.8989,
        -0.0033 * t + 0.0452,
    ];
    let cy = [
        -0.0167 * t - 0.2608,
        -0.0950 * t + 0.0092,
        -0.0079 * t + 0.2102,
        -0.0441 * t - 1.6537,
        -0.0109 * t + 0.0529,
    ];
    let sun_zenith = (90.0 - SUN_ELEVATION).to_radians();
    let chi = (4.0 / 9.0 - t / 120.0) * (std::f64::consts::PI - 2.0 * sun_zenith);
    let zenith_lum = (4.0453 * t - 4.9710) * tan(chi) - 0.2155 * t + 2.4192;
    let zenith_x = zenith_chroma(
        [
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ],
        sun_zenith,
    );
    let zenith_y = zenith_chroma(
        [
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ],
        sun_zenith,
    );
    let c = direction.y.max(0.02);
    let gamma = acos(direction.dot(sun_direction()).clamp(-1.0, 1.0));
    let ratio = |p: [f64; 5]| perez(p, c, gamma) / perez(p, 1.0, sun_zenith);
    let (y, x, z) = (
        zenith_lum * ratio(lum),
        zenith_x * ratio(cx),
        zenith_y * ratio(cy),
    );
    let (big_x, big_z) = (x / z * y, (1.0 - x - z) / z * y);
    [
        3.2406 * big_x - 1.5372 * y - 0.4986 * big_z,
        -0.9689 * big_x + 1.8758 * y + 0.0415 * big_z,
        0.0557 * big_x - 0.2040 * y + 1.0570 * big_z,
    ]
    .map(|v| v.max(0.0))
}

/// Thin high cloud cover in 0..1, noise on a plane overhead that is stretched along the wind.
fn cloud_cover(direction: DVec3) -> f64 {
    if direction.y <= 0.0 {
        return 0.0;
    }
    let reach = 1.0 / (direction.y + 0.12);
    let (along, across) = (
        direction.x * 0.8 + direction.z * 0.6,
        direction.z * 0.8 - direction.x * 0.6,
    );
    // Far more than the plane's reach per period, so no repetition is in sight.
    let (u, v) = (0.5 + along * reach / 34.0, 0.5 + across * reach / 20.0);
    let warp = 0.02 * fbm(u, v, 24, 3, 91);
    let billow = fbm(u + warp, v - warp, 20, 6, 17);
    let patches = fbm(u, v, 7, 2, 5);
    smoothstep(-0.02, 0.42, billow + 0.5 * patches) * smoothstep(0.02, 0.25, direction.y)
}

/// Radiance of sky and ground without the sun, before the scale to [`MEAN_SKY`].
fn unscaled(direction: DVec3) -> [f64; 3] {
    let clear = clear_sky(direction);
    let mean = (clear[0] + clear[1] + clear[2]) / 3.0;
    let sun_glow = 1.0 + 0.9 * exp(-2.5 * acos(direction.dot(sun_direction()).clamp(-1.0, 1.0)));
    let cloud = [1.0, 0.97, 0.93].map(|c| c * (0.6 * mean + 7.5) * sun_glow);
    // The model turns violet where the sun's glow meets the horizon; haze there is near white.
    let haze = [1.02, 1.0, 0.96].map(|c| c * mean);
    let low = 1.0 - smoothstep(0.0, 0.2, direction.y);
    mix3(
        mix3(clear, haze, 0.7 * low),
        cloud,
        0.75 * cloud_cover(direction),
    )
}

/// Share of a texel that the sun's disc covers, from 8 x 8 samples.
fn sun_share(x: usize, y: usize) -> f64 {
    const N: usize = 8;
    let sun = sun_direction();
    let edge = cos(SUN_RADIUS.to_radians());
    if texel_direction(x as f64 + 0.5, y as f64 + 0.5).dot(sun) < cos(4.0 * SUN_RADIUS.to_radians())
    {
        return 0.0;
    }
    let mut inside = 0;
    for k in 0..N * N {
        let (i, j) = (k % N, k / N);
        let at = |cell: usize, sub: usize| cell as f64 + (sub as f64 + 0.5) / N as f64;
        if texel_direction(at(x, i), at(y, j)).dot(sun) >= edge {
            inside += 1;
        }
    }
    f64::from(inside) / (N * N) as f64
}

/// Linear sRGB radiance of every texel, top row first.
pub fn radiance() -> Vec<[f64; 3]> {
    let (width, height) = SIZE;
    let half = height / 2;
    let mut texels = vec![GROUND; width * height];
    let (mut sum, mut angle) = (0.0, 0.0);
    for y in 0..half {
        for x in 0..width {
            let rgb = unscaled(texel_direction(x as f64 + 0.5, y as f64 + 0.5));
            sum += texel_solid_angle(y) * (rgb[0] + rgb[1] + rgb[2]) / 3.0;
            angle += texel_solid_angle(y);
            texels[y * width + x] = rgb;
        }
    }
    let scale = MEAN_SKY * angle / sum;
    for texel in &mut texels[..half * width] {
        *texel = texel.map(|v| v * scale);
    }
    soften_horizon(&mut texels);
    add_sun(&mut texels);
    texels
}

/// Blends the first rows below the horizon from the haze above it into the ground.
fn soften_horizon(texels: &mut [[f64; 3]]) {
    const ROWS: usize = 4;
    let (width, height) = SIZE;
    let horizon = height / 2;
    for row in 0..ROWS {
        let t = smoothstep(0.0, 1.0, (row as f64 + 1.0) / (ROWS as f64 + 1.0));
        for x in 0..width {
            let haze = texels[(horizon - 1) * width + x];
            texels[(horizon + row) * width + x] = mix3(haze, GROUND, t);
        }
    }
}

/// Adds the disc with the radiance that gives [`SUN_TO_SKY`].
fn add_sun(texels: &mut [[f64; 3]]) {
    let (width, height) = SIZE;
    let (mut sky, mut sun) = (0.0, 0.0);
    let mut shares = Vec::new();
    for y in 0..height / 2 {
        for x in 0..width {
            let weight = texel_solid_angle(y) * texel_direction(x as f64 + 0.5, y as f64 + 0.5).y;
            let [r, g, b] = texels[y * width + x];
            sky += weight * (r + g + b) / 3.0;
            let share = sun_share(x, y);
            if share > 0.0 {
                sun += weight * share * SUN_COLOR.iter().sum::<f64>() / 3.0;
                shares.push((y * width + x, share));
            }
        }
    }
    let peak = SUN_TO_SKY * sky / sun;
    for (index, share) in shares {
        for (value, color) in texels[index].iter_mut().zip(SUN_COLOR) {
            *value += peak * share * color;
        }
    }
}

/// The sky as a Radiance file.
pub fn sky_hdr() -> Vec<u8> {
    let texels: Vec<[u8; 4]> = radiance().into_iter().map(hdr::encode_rgbe).collect();
    hdr::encode_hdr(SIZE.0, SIZE.1, &texels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_image_is_plus_x() {
        let middle = texel_direction(256.0, 128.0);
        assert!(middle.abs_diff_eq(DVec3::X, 1e-12), "{middle}");
        assert!(texel_direction(384.0, 128.0).abs_diff_eq(DVec3::Z, 1e-12));
        assert!(texel_direction(0.0, 0.0).abs_diff_eq(DVec3::Y, 1e-12));
        let total: f64 = (0..SIZE.1).map(texel_solid_angle).sum::<f64>() * SIZE.0 as f64;
        assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-9);
    }

    #[test]
    fn energy_of_the_written_sky_is_as_designed() {
        let (mut mean, mut angle, mut sky, mut sun, mut peak) = (0.0, 0.0, 0.0, 0.0, 0.0_f64);
        let direction = sun_direction();
        let edge = cos((SUN_RADIUS + 1.5).to_radians());
        for (i, rgb) in radiance().into_iter().enumerate() {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let rgb = hdr::decode_rgbe(hdr::encode_rgbe(rgb));
            assert!(
                rgb.iter()
                    .all(|v| v.is_finite() && *v >= 0.0 && *v < 65504.0)
            );
            peak = peak.max(rgb[0]);
            let toward = texel_direction(x as f64 + 0.5, y as f64 + 0.5);
            let value = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
            if toward.y <= 0.0 {
                continue;
            }
            let weight = texel_solid_angle(y);
            if toward.dot(direction) > edge {
                sun += value * weight * toward.y;
            } else {
                sky += value * weight * toward.y;
                mean += value * weight;
                angle += weight;
            }
        }
        let ratio = sun / sky;
        assert!((3.0..5.0).contains(&ratio), "sun to sky {ratio}");
        assert!((ratio - SUN_TO_SKY).abs() < 0.15, "sun to sky {ratio}");
        assert!(
            (mean / angle - MEAN_SKY).abs() < 0.01,
            "mean {}",
            mean / angle
        );
        assert!((2000.0..20000.0).contains(&peak), "peak {peak}");
    }
}
