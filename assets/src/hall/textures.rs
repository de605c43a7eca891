//! Procedural textures of stone, cloth, leaf and metal.

use libm::{fabs, floor, pow, sin, sqrt};

use crate::noise::{fbm, hash01, mix3, smoothstep};
use crate::texture::Image;

const TAU: f64 = std::f64::consts::TAU;
const PI: f64 = std::f64::consts::PI;

/// What the floor is at a point of its repeat, which holds 2 x 2 tiles.
struct FloorPoint {
    /// Number of the tile, 0..4, or `None` on a dark inset.
    tile: Option<i64>,
    /// 0 on a joint, 1 on stone.
    stone: f64,
}

fn floor_point(u: f64, v: f64) -> FloorPoint {
    let (x, y) = (u * 2.0, v * 2.0);
    let (fx, fy) = (x - floor(x), y - floor(y));
    let border = fx.min(1.0 - fx).min(fy.min(1.0 - fy));
    // Distance in the diamond norm from the nearest tile corner makes the insets.
    let diamond = fx.min(1.0 - fx) + fy.min(1.0 - fy);
    let inset = 0.2;
    let joint = 0.009;
    let from_inset = fabs(diamond - inset) * std::f64::consts::FRAC_1_SQRT_2;
    if diamond < inset {
        return FloorPoint {
            tile: None,
            stone: smoothstep(joint * 0.5, joint * 1.6, from_inset),
        };
    }
    let cell = (floor(x) as i64).rem_euclid(2) + 2 * (floor(y) as i64).rem_euclid(2);
    FloorPoint {
        tile: Some(cell),
        stone: smoothstep(joint * 0.5, joint * 1.6, border.min(from_inset)),
    }
}

/// Strength of marble veins, thin ridges of warped noise.
fn veins(u: f64, v: f64, seed: u32) -> f64 {
    let warp = fbm(u, v, 4, 4, seed);
    let ridge = fabs(fbm(u + 0.12 * warp, v + 0.10 * warp, 3, 3, seed + 50));
    1.0 - smoothstep(0.0, 0.07, ridge)
}

/// Base colour of the marble floor.
pub fn floor_color() -> Image {
    Image::from_fn(512, 512, |u, v| {
        let point = floor_point(u, v);
        let stone = match point.tile {
            None => {
                let c = 0.5 + 0.5 * fbm(u, v, 16, 4, 3);
                mix3([0.16, 0.15, 0.16], [0.27, 0.25, 0.25], c)
            }
            Some(tile) => {
                let seed = 100 + 10 * tile as u32;
                let cloud = 0.5 + 0.5 * fbm(u, v, 4, 4, seed);
                let warm = tile == 1 || tile == 2;
                let (low, high, vein) = if warm {
                    ([0.66, 0.49, 0.37], [0.77, 0.62, 0.48], [0.86, 0.76, 0.65])
                } else {
                    ([0.80, 0.75, 0.67], [0.89, 0.85, 0.78], [0.62, 0.56, 0.50])
                };
                mix3(mix3(low, high, cloud), vein, 0.6 * veins(u, v, seed))
            }
        };
        mix3([0.42, 0.38, 0.33], stone, point.stone)
    })
}

/// Height of the floor in repeats: joints sunk, tiles faintly uneven.
pub fn floor_height(u: f64, v: f64) -> f64 {
    0.0022 * floor_point(u, v).stone + 0.0012 * fbm(u, v, 4, 2, 9)
}

/// Occlusion, roughness and metalness of the floor.
pub fn floor_orm() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let point = floor_point(u, v);
        let wear = fbm(u, v, 6, 4, 77);
        let polish = match point.tile {
            None => 0.16,
            Some(tile) => 0.2 + 0.04 * (tile % 3) as f64,
        };
        let rough = polish + 0.10 * smoothstep(-0.2, 0.6, wear);
        [
            0.6 + 0.4 * point.stone,
            0.8 + (rough - 0.8) * point.stone,
            0.0,
        ]
    })
}

/// A point of the ashlar wall: block hash in 0..1 and the distance to the joints as 0 (joint) to 1 (face).
fn ashlar(u: f64, v: f64) -> (f64, f64) {
    const COURSES: f64 = 4.0;
    const BLOCKS: f64 = 2.0;
    let row = floor(v * COURSES);
    let fy = v * COURSES - row;
    let x = u * BLOCKS + 0.5 * row + 0.25 * hash01(row as i64 & 3, 1, 8);
    let column = floor(x);
    let fx = x - column;
    let aspect = COURSES / BLOCKS;
    let wobble = 0.006 * fbm(u, v, 16, 2, 4);
    let border = (fx.min(1.0 - fx) * aspect).min(fy.min(1.0 - fy)) + wobble;
    let id = hash01(
        (column as i64).rem_euclid(BLOCKS as i64),
        (row as i64).rem_euclid(COURSES as i64),
        21,
    );
    (id, smoothstep(0.006, 0.04, border))
}

/// Base colour of the sandstone walls.
pub fn wall_color() -> Image {
    Image::from_fn(512, 512, |u, v| {
        let (id, face) = ashlar(u, v);
        let bed = fbm(u, v * 1.0, 6, 4, 31) + 0.35 * fbm(u, v, 32, 2, 32);
        let t = 0.5 + 0.42 * bed + 0.45 * (id - 0.5);
        let stone = mix3([0.66, 0.54, 0.40], [0.86, 0.77, 0.62], t);
        mix3([0.54, 0.46, 0.36], stone, 0.25 + 0.75 * face)
    })
}

/// Height of the walls in repeats.
pub fn wall_height(u: f64, v: f64) -> f64 {
    let (id, face) = ashlar(u, v);
    0.006 * face + 0.0012 * id * face + 0.0022 * fbm(u, v, 12, 3, 41)
}

/// Occlusion, roughness and metalness of the walls.
pub fn wall_orm() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let (_, face) = ashlar(u, v);
        let rough = 0.82 + 0.12 * fbm(u, v, 8, 3, 51);
        [0.7 + 0.3 * face, rough, 0.0]
    })
}

/// Base colour of the plain limestone of columns and plinths.
pub fn limestone_color() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let cloud = 0.5 + 0.5 * fbm(u, v, 4, 5, 61);
        let pits = smoothstep(0.30, 0.50, fbm(u, v, 24, 2, 62));
        let stone = mix3([0.78, 0.71, 0.60], [0.90, 0.85, 0.75], cloud);
        mix3(stone, [0.62, 0.54, 0.44], 0.55 * pits)
    })
}

/// Height of the limestone in repeats.
pub fn limestone_height(u: f64, v: f64) -> f64 {
    let pits = smoothstep(0.30, 0.50, fbm(u, v, 24, 2, 62));
    0.0022 * fbm(u, v, 8, 3, 63) - 0.0022 * pits
}

/// Depth of a plain weave: over and under threads, 1 on top.
fn weave(u: f64, v: f64, threads: f64) -> f64 {
    let (x, y) = (u * threads, v * threads);
    let (cx, cy) = (floor(x), floor(y));
    let over = ((cx + cy) as i64).rem_euclid(2) == 0;
    let (a, b) = (sin((x - cx) * PI), sin((y - cy) * PI));
    let (across, along) = if over { (a, b) } else { (b, a) };
    sqrt(across.max(0.0)) * (0.55 + 0.45 * along)
}

/// Pale woven cloth that the material's factor tints.
pub fn cloth_color() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let thread = weave(u, v, 32.0);
        let fade = 0.05 * fbm(u, v, 4, 3, 71);
        let c = 0.70 + 0.26 * thread + fade;
        [c, c * 0.985, c * 0.96]
    })
}

/// Height of the cloth in repeats.
pub fn cloth_height(u: f64, v: f64) -> f64 {
    0.006 * weave(u, v, 32.0)
}

/// Base colour of the carpet: a border and a chain of lozenges and rosettes; repeats down only.
pub fn carpet_color() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let x = fabs(u - 0.5) * 2.0;
        let red = [0.56, 0.07, 0.07];
        let gold = [0.85, 0.62, 0.22];
        let navy = [0.09, 0.12, 0.29];
        let cream = [0.88, 0.80, 0.65];
        let y = fabs(v - 0.5) * 2.0;
        let d = x / 0.66 + y;
        let mut c = red;
        let line = |at: f64, half: f64, value: f64| fabs(value - at) < half;
        if d < 0.92 {
            c = navy;
        }
        if line(0.92, 0.045, d) || line(1.08, 0.02, d) {
            c = gold;
        }
        let r = sqrt(x * x * 1.9 + y * y);
        let petals = 0.30 + 0.10 * libm::cos(8.0 * libm::atan2(y, x * 1.38));
        if r < petals {
            c = cream;
        }
        if r < petals - 0.07 {
            c = red;
        }
        if r < 0.09 {
            c = gold;
        }
        if x > 0.72 {
            c = navy;
            let step = v * 8.0 - floor(v * 8.0);
            if fabs(step - 0.5) * 0.25 + fabs(x - 0.835) < 0.085 {
                c = gold;
            }
        }
        if line(0.72, 0.018, x) || line(0.95, 0.018, x) {
            c = cream;
        }
        if x > 0.968 {
            c = red;
        }
        let thread = 0.82 + 0.18 * weave(u, v, 64.0) + 0.06 * fbm(u, v, 8, 3, 81);
        c.map(|k| k * thread)
    })
}

/// A feathered palm frond, stem at the bottom, with its shape in alpha.
pub fn leaf(size: usize) -> Image {
    Image::from_fn(size, size, |u, v| {
        const PAIRS: f64 = 11.0;
        let t = 1.0 - v;
        let s = (u - 0.5) * 2.0;
        let x = fabs(s);
        let reach = 0.96 * pow(sin(PI * pow(t.clamp(0.0, 1.0), 0.72)).max(0.0), 0.65);
        let out = if reach > 0.0 { x / reach } else { 9.0 };
        // Leaflets rise outwards; the two sides are half a step apart.
        let step = (t - 0.30 * x) * PAIRS + if s < 0.0 { 0.5 } else { 0.0 };
        let off = fabs(step - floor(step) - 0.5);
        let width = 0.44 * pow(sin(PI * (0.16 + 0.84 * out).clamp(0.0, 1.0)).max(0.0), 0.6);
        let soft = PAIRS / size as f64;
        let rooted = out < 1.0 && step >= 1.0;
        let leaflet = if rooted {
            smoothstep(-soft, soft, width - off)
        } else {
            0.0
        };
        let stem = smoothstep(-0.008, 0.008, 0.022 * (1.05 - t) + 0.004 - x * 0.5);
        let shade = 0.5 + 0.5 * fbm(u, v, 8, 3, 201);
        let rib = 1.0 - smoothstep(0.02, 0.10, off);
        let green = mix3(
            [0.13, 0.30, 0.07],
            [0.36, 0.52, 0.13],
            0.35 * shade + 0.4 * out.min(1.0),
        );
        let green = mix3(green, [0.56, 0.64, 0.27], 0.45 * rib);
        let c = mix3(green, [0.46, 0.44, 0.18], stem);
        [c[0], c[1], c[2], leaflet.max(stem)]
    })
}

/// Occlusion, roughness and metalness of brushed metal; the strokes run along u.
pub fn brushed_orm() -> Image {
    Image::from_fn(256, 256, |u, v| {
        let fine = fbm(u, v * 16.0 - floor(v * 16.0), 2, 1, 0) * 0.04;
        let row = floor(v * 256.0) as i64;
        let stroke = hash01(row, 0, 5) * 0.5 + hash01(row, floor(u * 6.0) as i64, 6) * 0.2;
        let slow = 0.06 * sin(u * TAU + 9.0 * hash01(row, 2, 7));
        [1.0, 0.22 + 0.32 * stroke + slow + fine, 1.0]
    })
}
