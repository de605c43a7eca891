//! Tiling gradient noise for the procedural textures.

use libm::floor;

/// Integer hash with full avalanche (the finaliser of MurmurHash3, Appleby 2011).
pub fn hash(x: i64, y: i64, seed: u32) -> u32 {
    let mut h = (x as u32)
        .wrapping_mul(0x9e37_79b1)
        .wrapping_add((y as u32).wrapping_mul(0x85eb_ca77))
        .wrapping_add(seed.wrapping_mul(0xc2b2_ae3d));
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// A number in [0, 1) per lattice cell.
pub fn hash01(x: i64, y: i64, seed: u32) -> f64 {
    f64::from(hash(x, y, seed)) / 4_294_967_296.0
}

fn corner(ix: i64, iy: i64, period: i64, seed: u32, dx: f64, dy: f64) -> f64 {
    const D: f64 = std::f64::consts::FRAC_1_SQRT_2;
    const GRADIENTS: [[f64; 2]; 8] = [
        [1.0, 0.0],
        [-1.0, 0.0],
        [0.0, 1.0],
        [0.0, -1.0],
        [D, D],
        [-D, D],
        [D, -D],
        [-D, -D],
    ];
    let h = hash(ix.rem_euclid(period), iy.rem_euclid(period), seed);
    let g = GRADIENTS[(h & 7) as usize];
    g[0] * dx + g[1] * dy
}

/// Perlin's improved gradient noise (SIGGRAPH 2002) in about [-1, 1]; it repeats every `period` in x and in y.
pub fn perlin(x: f64, y: f64, period: i64, seed: u32) -> f64 {
    let (fx, fy) = (floor(x), floor(y));
    let (ix, iy) = (fx as i64, fy as i64);
    let (dx, dy) = (x - fx, y - fy);
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(dx), fade(dy));
    let at = |i: i64, j: i64| corner(ix + i, iy + j, period, seed, dx - i as f64, dy - j as f64);
    let top = at(0, 0) + u * (at(1, 0) - at(0, 0));
    let bottom = at(0, 1) + u * (at(1, 1) - at(0, 1));
    (top + v * (bottom - top)) * std::f64::consts::SQRT_2
}

/// Sum of `octaves` octaves of [`perlin`] over the unit square, in about [-1, 1]; the first has `cells` cells a side.
pub fn fbm(u: f64, v: f64, cells: i64, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut total, mut period) = (0.0, 1.0, 0.0, cells);
    for octave in 0..octaves {
        let scale = period as f64;
        sum += weight * perlin(u * scale, v * scale, period, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.5;
        period *= 2;
    }
    sum / total
}

/// Hermite step from 0 at `low` to 1 at `high`.
pub fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear blend of colours.
pub fn mix3(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fbm_tiles_and_stays_bounded() {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for i in 0..64 {
            let t = f64::from(i) / 64.0;
            assert!((fbm(t, 0.0, 4, 4, 7) - fbm(t, 1.0, 4, 4, 7)).abs() < 1e-12);
            assert!((fbm(0.0, t, 4, 4, 7) - fbm(1.0, t, 4, 4, 7)).abs() < 1e-12);
            for j in 0..64 {
                let n = fbm(t, f64::from(j) / 64.0, 4, 4, 7);
                low = low.min(n);
                high = high.max(n);
            }
        }
        assert!(low < -0.3 && high > 0.3, "{low}..{high}");
        assert!(low >= -1.0 && high <= 1.0, "{low}..{high}");
    }
}
