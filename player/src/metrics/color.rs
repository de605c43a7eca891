//! Colour spaces: sRGB (IEC 61966-2-1), CIE XYZ, CIELAB and the opponent space YCxCz, all for D65.

/// Linear sRGB primaries to XYZ, D65; the white point is the sum of each row.
pub const RGB_TO_XYZ: [[f64; 3]; 3] = [
    [0.412_456_4, 0.357_576_1, 0.180_437_5],
    [0.212_672_9, 0.715_152_2, 0.072_175_0],
    [0.019_333_9, 0.119_192_0, 0.950_304_1],
];

/// XYZ of linear RGB (1, 1, 1).
const WHITE: [f64; 3] = [
    RGB_TO_XYZ[0][0] + RGB_TO_XYZ[0][1] + RGB_TO_XYZ[0][2],
    RGB_TO_XYZ[1][0] + RGB_TO_XYZ[1][1] + RGB_TO_XYZ[1][2],
    RGB_TO_XYZ[2][0] + RGB_TO_XYZ[2][1] + RGB_TO_XYZ[2][2],
];

/// Inverse of [`RGB_TO_XYZ`], by cofactors.
const XYZ_TO_RGB: [[f64; 3]; 3] = inverse(RGB_TO_XYZ);

const fn inverse(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let determinant = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    let mut out = [[0.0; 3]; 3];
    let mut row = 0;
    while row < 3 {
        let mut column = 0;
        while column < 3 {
            let (a, b) = ((column + 1) % 3, (column + 2) % 3);
            let (c, d) = ((row + 1) % 3, (row + 2) % 3);
            out[row][column] = (m[a][c] * m[b][d] - m[a][d] * m[b][c]) / determinant;
            column += 1;
        }
        row += 1;
    }
    out
}

fn multiply(matrix: &[[f64; 3]; 3], vector: [f32; 3]) -> [f32; 3] {
    let row = |row: &[f64; 3]| row.iter().zip(vector).map(|(m, v)| *m as f32 * v).sum();
    [row(&matrix[0]), row(&matrix[1]), row(&matrix[2])]
}

/// Encoded to linear; any real number.
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        libm::powf((value + 0.055) / 1.055, 2.4)
    }
}

/// Linear to encoded; any real number.
pub fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 {
        value * 12.92
    } else {
        1.055 * libm::powf(value, 1.0 / 2.4) - 0.055
    }
}

/// Relative luminance of linear RGB.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    let [r, g, b] = RGB_TO_XYZ[1].map(|weight| weight as f32);
    rgb[0] * r + rgb[1] * g + rgb[2] * b
}

/// Linear RGB to YCxCz: CIELAB without its cube roots, so that it can be filtered.
pub fn rgb_to_ycxcz(rgb: [f32; 3]) -> [f32; 3] {
    let xyz = multiply(&RGB_TO_XYZ, rgb);
    let [x, y, z] = std::array::from_fn(|axis| xyz[axis] / WHITE[axis] as f32);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Inverse of [`rgb_to_ycxcz`].
pub fn ycxcz_to_rgb([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    multiply(
        &XYZ_TO_RGB,
        std::array::from_fn(|axis| relative[axis] * WHITE[axis] as f32),
    )
}

/// Linear RGB to CIELAB.
pub fn rgb_to_lab(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let xyz = multiply(&RGB_TO_XYZ, rgb);
    let f: [f32; 3] = std::array::from_fn(|axis| {
        let t = xyz[axis] / WHITE[axis] as f32;
        if t > DELTA * DELTA * DELTA {
            libm::cbrtf(t)
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    });
    [
        116.0 * f[1] - 16.0,
        500.0 * (f[0] - f[1]),
        200.0 * (f[1] - f[2]),
    ]
}
