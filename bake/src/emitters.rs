//! How much light each emissive triangle gives, its texture included, and the table that draws triangles by it.

use std::collections::{BTreeMap, BTreeSet};

use cairn_format::gpu::{EmissiveAliasEntry, EmissiveAliasHeader, EmissiveTriangle};
use rayon::prelude::*;

use crate::alias;
use crate::cache::{Inputs, Kind, Session};
use crate::diagnostic::Result;
use crate::encode::srgb::decode_f64;
use crate::import::decode_image;
use crate::prepare::MaterialUse;
use crate::scene::{Material, Sampler, Scene, Wrap};

/// Most samples along one edge of a triangle: beyond, a coarser level of the texture is read, so that every texel
/// still counts.
const MAX_STEPS: f32 = 32.0;
/// Fewest samples along one edge.
const MIN_STEPS: f32 = 2.0;

/// [`weigh`] by way of the cache.
///
/// # Errors
/// As there.
pub fn weigh_cached(
    scene: &Scene,
    materials: &[Option<u32>],
    triangles: &mut [EmissiveTriangle],
    limit_pixels: u64,
    session: &Session,
) -> Result<()> {
    if triangles.is_empty() {
        return Ok(());
    }
    let inputs = || inputs(scene, materials, triangles, limit_pixels);
    let powers: Vec<f32> = session.fetch(inputs, || {
        let mut weighed = triangles.to_vec();
        weigh(scene, materials, &mut weighed, limit_pixels)?;
        Ok(weighed.iter().map(|triangle| triangle.power).collect())
    })?;
    for (triangle, power) in triangles.iter_mut().zip(powers) {
        triangle.power = power;
    }
    Ok(())
}

/// What decides the powers: the triangles, their materials, and the textures of those.
fn inputs(
    scene: &Scene,
    materials: &[Option<u32>],
    triangles: &[EmissiveTriangle],
    limit_pixels: u64,
) -> Inputs {
    let used: BTreeSet<u32> = triangles.iter().map(|found| found.material_index).collect();
    let used = used
        .iter()
        .filter_map(|record| materials[*record as usize])
        .map(|source| &scene.materials[source as usize]);
    let mut inputs = Inputs::new(Kind::EmissivePowers, module_path!(), "emissive triangles")
        .content("triangles", bytemuck::cast_slice(triangles))
        .settings("limit", &limit_pixels);
    for material in used {
        inputs = inputs.settings(&format!("material `{}`", material.name), material);
        if let Some(reference) = MaterialUse::of(Some(material)).emissive {
            let texture = scene.textures[reference.texture as usize];
            let sampler = texture.sampler.map(|index| scene.samplers[index as usize]);
            let image = &scene.images[texture.image as usize];
            inputs = inputs
                .content(&format!("image `{}`", image.name), &image.bytes)
                .settings("sampler", &sampler);
        }
    }
    inputs
}

/// Fills in the powers of `triangles`; `materials` are the scene's materials of their material records.
///
/// # Errors
/// An image that cannot be decoded.
pub fn weigh(
    scene: &Scene,
    materials: &[Option<u32>],
    triangles: &mut [EmissiveTriangle],
    limit_pixels: u64,
) -> Result<()> {
    let mut maps: BTreeMap<u32, Pyramid> = BTreeMap::new();
    let material = |triangle: &EmissiveTriangle| {
        let source = materials[triangle.material_index as usize]?;
        Some(&scene.materials[source as usize])
    };
    for found in triangles.iter().filter_map(material) {
        let Some(texture) = MaterialUse::of(Some(found)).emissive else {
            continue;
        };
        if let std::collections::btree_map::Entry::Vacant(entry) = maps.entry(texture.texture) {
            entry.insert(Pyramid::of(scene, texture.texture, limit_pixels)?);
        }
    }
    triangles.par_iter_mut().for_each(|triangle| {
        let Some(found) = material(triangle) else {
            return;
        };
        let map = MaterialUse::of(Some(found))
            .emissive
            .and_then(|texture| maps.get(&texture.texture));
        triangle.power = power(triangle, found, map);
    });
    Ok(())
}

/// The alias table's words: header and entries. Empty where nothing shines.
pub fn table(triangles: &[EmissiveTriangle]) -> Vec<u32> {
    let weights: Vec<f64> = triangles
        .iter()
        .map(|triangle| f64::from(triangle.power))
        .collect();
    let (cells, total) = alias::build(&weights);
    if cells.is_empty() {
        return Vec::new();
    }
    let header = EmissiveAliasHeader {
        count: cells.len() as u32,
        total_power: total as f32,
    };
    let entries: Vec<EmissiveAliasEntry> = cells
        .iter()
        .map(|cell| EmissiveAliasEntry {
            prob: cell.keep,
            alias_index: cell.other,
        })
        .collect();
    let mut words: Vec<u32> = bytemuck::cast_slice(&[header]).to_vec();
    words.extend_from_slice(bytemuck::cast_slice(&entries));
    words
}

fn power(triangle: &EmissiveTriangle, material: &Material, map: Option<&Pyramid>) -> f32 {
    let mean = map.map_or([1.0; 3], |map| {
        map.mean([triangle.uv0, triangle.uv1, triangle.uv2])
    });
    let weights = [0.2126, 0.7152, 0.0722];
    let luminance: f64 = (0..3)
        .map(|channel| weights[channel] * f64::from(triangle.emission[channel]) * mean[channel])
        .sum();
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let power = luminance * f64::from(triangle.area) * std::f64::consts::PI * sides;
    power.min(f64::from(f32::MAX)) as f32
}

/// A texture in linear light with its box-filtered levels.
struct Pyramid {
    levels: Vec<Level>,
    wrap: [Wrap; 2],
}

struct Level {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
}

impl Pyramid {
    fn of(scene: &Scene, texture: u32, limit_pixels: u64) -> Result<Self> {
        let texture = scene.textures[texture as usize];
        let image = decode_image(&scene.images[texture.image as usize], limit_pixels)?;
        let sampler = texture
            .sampler
            .map_or_else(Sampler::default, |index| scene.samplers[index as usize]);
        let linear: Vec<f32> = (0..=u16::MAX)
            .map(|code| decode_f64(f64::from(code) / 65535.0) as f32)
            .collect();
        let base = Level {
            width: image.width as usize,
            height: image.height as usize,
            texels: image
                .texels
                .iter()
                .map(|[r, g, b, _]| [*r, *g, *b].map(|code| linear[usize::from(code)]))
                .collect(),
        };
        let mut levels = vec![base];
        while let Some(level) = levels.last().and_then(Level::halved) {
            levels.push(level);
        }
        Ok(Self {
            levels,
            wrap: [sampler.wrap_u, sampler.wrap_v],
        })
    }

    /// Mean over a triangle: bilinear lookups at the centres of congruent parts, each at most a texel wide.
    fn mean(&self, corners: [[f32; 2]; 3]) -> [f64; 3] {
        let size = [self.levels[0].width as f32, self.levels[0].height as f32];
        let edge = |a: [f32; 2], b: [f32; 2]| {
            let (u, v) = ((a[0] - b[0]) * size[0], (a[1] - b[1]) * size[1]);
            u.hypot(v)
        };
        let [a, b, c] = corners;
        let longest = edge(a, b).max(edge(b, c)).max(edge(c, a));
        if !longest.is_finite() {
            return [1.0; 3];
        }
        let level = (longest / MAX_STEPS).max(1.0).log2().ceil() as usize;
        let level = level.min(self.levels.len() - 1);
        let steps = (longest / (1u32 << level.min(31)) as f32).clamp(MIN_STEPS, MAX_STEPS);
        let steps = steps.ceil() as usize;
        let mut sum = [0.0; 3];
        for row in 0..steps {
            for part in 0..2 * row + 1 {
                let texel =
                    self.levels[level].bilinear(center(corners, steps, row, part), self.wrap);
                for (sum, value) in sum.iter_mut().zip(texel) {
                    *sum += f64::from(value);
                }
            }
        }
        sum.map(|value| value / (steps * steps) as f64)
    }
}

/// Centre of one of the `steps * steps` congruent parts of a triangle; row `r` has `2 r + 1` of them.
fn center(corners: [[f32; 2]; 3], steps: usize, row: usize, part: usize) -> [f32; 2] {
    let down = part % 2 == 1;
    let along = (part / 2) as f32;
    let third = 1.0 / 3.0;
    let (across, below) = if down {
        (along + 2.0 * third, row as f32 + third)
    } else {
        (along + third, row as f32 + 2.0 * third)
    };
    let n = steps as f32;
    let weights = [1.0 - below / n, (below - across) / n, across / n];
    std::array::from_fn(|axis| {
        (0..3)
            .map(|corner| weights[corner] * corners[corner][axis])
            .sum()
    })
}

impl Level {
    /// The next level; `None` of a single texel.
    fn halved(&self) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let texel = |x: usize, y: usize| {
            self.texels[y.min(self.height - 1) * self.width + x.min(self.width - 1)]
        };
        let texels = (0..width * height)
            .map(|index| {
                let (x, y) = (index % width * 2, index / width * 2);
                let four = [
                    texel(x, y),
                    texel(x + 1, y),
                    texel(x, y + 1),
                    texel(x + 1, y + 1),
                ];
                std::array::from_fn(|channel| {
                    four.iter().map(|texel| texel[channel]).sum::<f32>() * 0.25
                })
            })
            .collect();
        Some(Self {
            width,
            height,
            texels,
        })
    }

    fn bilinear(&self, [u, v]: [f32; 2], wrap: [Wrap; 2]) -> [f32; 3] {
        let place = |coordinate: f32, size: usize| {
            let at = coordinate * size as f32 - 0.5;
            let floor = at.floor();
            (floor, at - floor)
        };
        let ((x, fx), (y, fy)) = (place(u, self.width), place(v, self.height));
        let columns = [x, x + 1.0].map(|at| wrapped(at, self.width, wrap[0]));
        let rows = [y, y + 1.0].map(|at| wrapped(at, self.height, wrap[1]));
        let texel =
            |row: usize, column: usize| self.texels[rows[row] * self.width + columns[column]];
        std::array::from_fn(|channel| {
            let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
            let [top, bottom] =
                [0, 1].map(|row| mix(texel(row, 0)[channel], texel(row, 1)[channel], fx));
            mix(top, bottom, fy)
        })
    }
}

fn wrapped(at: f32, size: usize, wrap: Wrap) -> usize {
    let (at, size) = (at as i64, size as i64);
    let index = match wrap {
        Wrap::Repeat => at.rem_euclid(size),
        Wrap::MirroredRepeat => {
            let period = at.rem_euclid(2 * size);
            period.min(2 * size - 1 - period)
        }
        Wrap::ClampToEdge => at.clamp(0, size - 1),
    };
    index as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker(size: usize) -> Pyramid {
        let texels = (0..size * size)
            .map(|index| {
                let bright = index % size < size / 4 && index / size < size / 4;
                if bright { [1.0, 0.5, 0.0] } else { [0.0; 3] }
            })
            .collect();
        let mut levels = vec![Level {
            width: size,
            height: size,
            texels,
        }];
        while let Some(level) = levels.last().and_then(Level::halved) {
            levels.push(level);
        }
        Pyramid {
            levels,
            wrap: [Wrap::Repeat; 2],
        }
    }

    #[test]
    fn two_halves_of_a_square_hold_its_mean() {
        for size in [4, 64, 512] {
            let map = checker(size);
            let (a, b, c, d) = ([0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]);
            let means = [map.mean([a, b, c]), map.mean([a, c, d])];
            let mean = (means[0][0] + means[1][0]) / 2.0;
            assert!((mean - 1.0 / 16.0).abs() < 2e-3, "{size}: {mean}");
            assert_eq!(means[0][2], 0.0);
        }
    }

    #[test]
    fn every_bright_texel_counts() {
        let mut map = checker(1024);
        for texel in &mut map.levels[0].texels {
            *texel = [0.0; 3];
        }
        map.levels[0].texels[700 * 1024 + 900] = [1.0; 3];
        map.levels.truncate(1);
        while let Some(level) = map.levels.last().and_then(Level::halved) {
            map.levels.push(level);
        }
        let mean = map.mean([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
        assert!(mean[0] > 0.0);
    }

    #[test]
    fn parts_fill_the_triangle() {
        let corners = [[0.0, 0.0], [3.0, 1.0], [1.0, 2.0]];
        for steps in [1, 2, 5] {
            let mut sum = [0.0; 2];
            for row in 0..steps {
                for part in 0..2 * row + 1 {
                    let place = center(corners, steps, row, part);
                    sum = [sum[0] + place[0], sum[1] + place[1]];
                }
            }
            let mean = sum.map(|value| value / (steps * steps) as f32);
            assert!((mean[0] - 4.0 / 3.0).abs() < 1e-5 && (mean[1] - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn the_table_has_header_and_entries() {
        let mut triangles = vec![bytemuck::Zeroable::zeroed(); 3];
        assert!(table(&triangles).is_empty());
        triangles[1] = EmissiveTriangle {
            power: 2.0,
            ..triangles[1]
        };
        let words = table(&triangles);
        assert_eq!(words.len(), 2 + 3 * 2);
        assert_eq!((words[0], f32::from_bits(words[1])), (3, 2.0));
        assert_eq!(
            f32::from_bits(words[2]),
            0.0,
            "a dark triangle is never drawn"
        );
        assert_eq!(words[3], 1);
    }
}
