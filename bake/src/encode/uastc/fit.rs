//! Fits a line with quantised ends and evenly placed weights to texels.

use std::ops::Range;

/// Rounds of assigning weights and solving for the ends.
const ROUNDS: usize = 3;
/// Steps towards the axis of largest spread.
const POWER_STEPS: usize = 6;

/// ASTC's weights in sixty-fourths, by their number of bits.
const WEIGHTS: [&[f32]; 6] = [
    &[],
    &[0.0, 64.0],
    &[0.0, 21.0, 43.0, 64.0],
    &[0.0, 9.0, 18.0, 27.0, 37.0, 46.0, 55.0, 64.0],
    &[
        0.0, 4.0, 8.0, 12.0, 17.0, 21.0, 25.0, 29.0, 35.0, 39.0, 43.0, 47.0, 52.0, 56.0, 60.0, 64.0,
    ],
    &[
        0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0, 30.0,
        34.0, 36.0, 38.0, 40.0, 42.0, 44.0, 46.0, 48.0, 50.0, 52.0, 54.0, 56.0, 58.0, 60.0, 62.0,
        64.0,
    ],
];

/// The values that an endpoint may have.
pub(super) struct Levels {
    /// Value of each code.
    values: Vec<u8>,
    /// Code of the nearest value of each 8-bit number.
    nearest: [u8; 256],
}

impl Levels {
    pub fn new(values: Vec<u8>) -> Self {
        let mut nearest = [0; 256];
        for (number, nearest) in (0_i32..).zip(&mut nearest) {
            let distance = |code: &usize| (i32::from(values[*code]) - number).abs();
            *nearest = (0..values.len()).min_by_key(distance).unwrap_or(0) as u8;
        }
        Self { values, nearest }
    }

    fn code(&self, value: f32) -> u8 {
        self.nearest[(value + 0.5).clamp(0.0, 255.0) as usize]
    }

    fn value(&self, code: u8) -> f32 {
        f32::from(self.values[usize::from(code)])
    }
}

/// The texels of a block, and how much each component counts.
pub(super) struct Points {
    texels: [[f32; 4]; 16],
    scales: [f32; 4],
    components: usize,
}

impl Points {
    /// Of two components the first is luminance, which shows in three channels.
    pub fn new(texels: [[f32; 4]; 16], components: usize) -> Self {
        let scales = match components {
            2 => [3.0, 1.0, 0.0, 0.0],
            3 => [1.0, 1.0, 1.0, 0.0],
            _ => [1.0; 4],
        };
        Self {
            texels,
            scales,
            components,
        }
    }

    /// The same where one component does not count.
    pub fn without(&self, component: usize) -> Self {
        let mut scales = self.scales;
        scales[component] = 0.0;
        Self {
            texels: self.texels,
            scales,
            components: self.components,
        }
    }

    fn mean(&self, members: &[usize]) -> [f32; 4] {
        let mut mean = [0.0; 4];
        for &texel in members {
            for (sum, value) in mean.iter_mut().zip(self.texels[texel]) {
                *sum += value;
            }
        }
        mean.map(|sum| sum / members.len().max(1) as f32)
    }

    /// Axis of the largest spread about the mean, of unit length, and the spread that lies off it.
    fn axis(&self, members: &[usize], mean: &[f32; 4]) -> ([f32; 4], f32) {
        let mut covariance = [[0.0_f32; 4]; 4];
        for &texel in members {
            let offset: [f32; 4] =
                std::array::from_fn(|c| (self.texels[texel][c] - mean[c]) * self.scales[c]);
            for row in 0..4 {
                for column in 0..4 {
                    covariance[row][column] += offset[row] * offset[column];
                }
            }
        }
        let widest = (0..4).fold(0, |widest, c| {
            if covariance[c][c] > covariance[widest][widest] {
                c
            } else {
                widest
            }
        });
        let mut axis = covariance[widest];
        let mut along = 0.0;
        for _ in 0..POWER_STEPS {
            let length = dot(&axis, &axis).sqrt();
            if length <= 1e-6 {
                return ([0.0; 4], 0.0);
            }
            axis = axis.map(|value| value / length);
            let next: [f32; 4] = std::array::from_fn(|row| dot(&covariance[row], &axis));
            along = dot(&next, &axis);
            axis = next;
        }
        let length = dot(&axis, &axis).sqrt().max(1e-6);
        let spread: f32 = (0..4).map(|c| covariance[c][c]).sum();
        (axis.map(|value| value / length), (spread - along).max(0.0))
    }
}

fn dot(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// The `count` patterns whose subsets lie nearest to lines, best first.
pub(super) fn patterns(points: &Points, patterns: &[[u8; 16]], count: usize) -> Vec<usize> {
    if count == 0 {
        return Vec::new();
    }
    let mut ranked: Vec<(f32, usize)> = patterns
        .iter()
        .enumerate()
        .map(|(number, pattern)| {
            let off = |subset: u8| {
                let members: Vec<usize> =
                    (0..16).filter(|&texel| pattern[texel] == subset).collect();
                let mean = points.mean(&members);
                points.axis(&members, &mean).1
            };
            ((0..3).map(off).sum(), number)
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate(count);
    ranked.into_iter().map(|(_, number)| number).collect()
}

/// Endpoint codes of each component, a weight of each member, and the squared error of what is shown.
pub(super) struct Fit {
    pub endpoints: [[u8; 2]; 4],
    pub weights: [u8; 16],
    pub error: f32,
}

impl Fit {
    /// Fits the `components` of some of the texels.
    pub fn of(
        points: &Points,
        members: &[usize],
        components: Range<usize>,
        weight_bits: u32,
        levels: &Levels,
    ) -> Self {
        let steps = WEIGHTS[weight_bits as usize];
        let mut own = Points {
            texels: points.texels,
            scales: [0.0; 4],
            components: points.components,
        };
        own.scales[components.clone()].copy_from_slice(&points.scales[components.clone()]);
        let mut ends = own.spanned(members);
        let mut best: Option<Self> = None;
        for _ in 0..ROUNDS {
            let fit = own.assigned(members, &components, &ends, steps, levels);
            let Some(next) = own.solved(members, &fit.weights, steps) else {
                best = Some(fit.or_better(best));
                break;
            };
            best = Some(fit.or_better(best));
            ends = next;
        }
        best.expect("there is at least one round")
    }

    fn or_better(self, other: Option<Self>) -> Self {
        match other {
            Some(other) if other.error <= self.error => other,
            _ => self,
        }
    }
}

impl Points {
    /// Ends of the members along their axis.
    fn spanned(&self, members: &[usize]) -> [[f32; 4]; 2] {
        let mean = self.mean(members);
        let (axis, _) = self.axis(members, &mean);
        let (mut least, mut most) = (0.0_f32, 0.0_f32);
        for &texel in members {
            let offset: [f32; 4] =
                std::array::from_fn(|c| (self.texels[texel][c] - mean[c]) * self.scales[c]);
            let along = dot(&offset, &axis);
            (least, most) = (least.min(along), most.max(along));
        }
        let at = |along: f32| {
            std::array::from_fn(|c| {
                let scale = if self.scales[c] > 0.0 {
                    self.scales[c]
                } else {
                    1.0
                };
                mean[c] + axis[c] * along / scale
            })
        };
        [at(least), at(most)]
    }

    /// Quantised ends, the nearest weight of each member, and their error.
    fn assigned(
        &self,
        members: &[usize],
        components: &Range<usize>,
        ends: &[[f32; 4]; 2],
        steps: &[f32],
        levels: &Levels,
    ) -> Fit {
        let mut fit = Fit {
            endpoints: [[0; 2]; 4],
            weights: [0; 16],
            error: 0.0,
        };
        let mut palette = [[0.0_f32; 4]; 32];
        for c in components.clone() {
            let codes = [levels.code(ends[0][c]), levels.code(ends[1][c])];
            fit.endpoints[c] = codes;
            let [low, high] = codes.map(|code| levels.value(code) as u32 * 257);
            for (entry, step) in palette.iter_mut().zip(steps) {
                let step = *step as u32;
                entry[c] = (((low * (64 - step) + high * step + 32) / 64) >> 8) as f32;
            }
        }
        for (at, &texel) in members.iter().enumerate() {
            let mut least = f32::INFINITY;
            for (weight, entry) in palette[..steps.len()].iter().enumerate() {
                let mut error = 0.0;
                for c in components.clone() {
                    let difference = entry[c] - self.texels[texel][c];
                    error += difference * difference * self.scales[c];
                }
                if error < least {
                    least = error;
                    fit.weights[at] = weight as u8;
                }
            }
            fit.error += least;
        }
        fit
    }

    /// The ends of least squared error for the weights; none where all weights are one.
    fn solved(
        &self,
        members: &[usize],
        weights: &[u8; 16],
        steps: &[f32],
    ) -> Option<[[f32; 4]; 2]> {
        let (mut aa, mut ab, mut bb) = (0.0_f32, 0.0_f32, 0.0_f32);
        let (mut av, mut bv) = ([0.0_f32; 4], [0.0_f32; 4]);
        for (&texel, &weight) in members.iter().zip(weights) {
            let b = steps[usize::from(weight)] / 64.0;
            let a = 1.0 - b;
            aa += a * a;
            ab += a * b;
            bb += b * b;
            for c in 0..4 {
                av[c] += a * self.texels[texel][c];
                bv[c] += b * self.texels[texel][c];
            }
        }
        let determinant = aa * bb - ab * ab;
        (determinant > 1e-3).then(|| {
            [
                std::array::from_fn(|c| (av[c] * bb - bv[c] * ab) / determinant),
                std::array::from_fn(|c| (bv[c] * aa - av[c] * ab) / determinant),
            ]
        })
    }
}
