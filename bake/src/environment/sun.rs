//! Finds the sun of a map and takes its energy out: what is left is the sky around it.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::cubemap::to_f32;
use super::equirect::{Equirect, Rows};

/// A sun is at least this much brighter than the mean of what remains of the map.
const LEAST_CONTRAST: f64 = 1000.0;
/// Largest angular radius that still counts as a sun, radians (2 degrees; the sun's own is 0.267).
const LARGEST_RADIUS: f64 = 2.0 * PI / 180.0;
/// Texels next to the peak belong to the sun down to this fraction of its luminance.
const EXTENT: f64 = 0.01;

/// What becomes of the sun.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SunMode {
    /// Taken out of the cubes where there is one, and kept as a light.
    #[default]
    Auto,
    /// Left in the cubes.
    Keep,
    /// Taken out of the cubes, and dropped.
    Off,
}

/// A uniform disc of radiance `color * illuminance / (pi sin^2(angular_radius))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtractedSun {
    /// Unit vector towards the sun.
    pub direction: [f32; 3],
    /// Linear RGB, largest channel 1.
    pub color: [f32; 3],
    /// Perpendicular irradiance of the largest channel.
    pub illuminance: f32,
    /// Radians.
    pub angular_radius: f32,
}

impl ExtractedSun {
    /// Radiance integrated over the disc's solid angle, in f64 over the stored values.
    pub fn energy(&self) -> DVec3 {
        let radius = f64::from(self.angular_radius);
        // Solid angle 2 pi (1 - cos r) over projected solid angle pi sin^2 r.
        let ratio = 2.0 / (1.0 + libm::cos(radius));
        DVec3::from(self.color.map(f64::from)) * (f64::from(self.illuminance) * ratio)
    }
}

/// Takes the sun out of the map; `None`, and the map as it was, where it has none.
///
/// The sun is the connected region around the brightest texel, if it is small and bright enough. Each of its
/// texels keeps what its surroundings have; all above that becomes the disc, whose radius is that of a
/// uniform disc with the region's ratio of squared energy to energy of squares, and whose energy is exactly
/// what left the map.
pub(super) fn extract(input: &mut Equirect, rows: &Rows) -> Option<ExtractedSun> {
    let map = Map { input, rows };
    let (peak, brightest) = map.brightest()?;
    let region = map.region(peak, brightest * EXTENT)?;
    let surroundings = map.surroundings(&region)?;
    let light = map.light(&region, surroundings);
    let remaining = luminance(input.energy(rows) - light.energy).max(0.0) / (4.0 * PI);
    let solid_angle = light.squared / light.squares;
    let radius = libm::acos((1.0 - solid_angle / TAU).clamp(-1.0, 1.0));
    if brightest < LEAST_CONTRAST * remaining || radius > LARGEST_RADIUS {
        return None;
    }
    let largest = light.energy.max_element();
    let direction = light.moment.try_normalize()?;
    let angular_radius = radius as f32;
    let ratio = 0.5 * (1.0 + libm::cos(f64::from(angular_radius)));
    let sun = ExtractedSun {
        direction: to_f32(direction),
        color: to_f32(light.energy / largest),
        illuminance: (largest * ratio) as f32,
        angular_radius,
    };
    let sound = sun.illuminance.is_finite() && sun.illuminance > 0.0 && angular_radius > 0.0;
    if !sound {
        return None;
    }
    for index in region {
        let texel = &mut input.texels[index];
        *texel = std::array::from_fn(|k| texel[k].min(surroundings[k]));
    }
    Some(sun)
}

fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

struct Map<'a> {
    input: &'a Equirect,
    rows: &'a Rows,
}

/// Sums over what leaves the map.
struct Light {
    energy: DVec3,
    /// Directions weighted by energy.
    moment: DVec3,
    /// Square of the summed luminance times steradians.
    squared: f64,
    /// Sum of squared luminance times steradians.
    squares: f64,
}

impl Map<'_> {
    fn texel(&self, index: usize) -> DVec3 {
        let width = self.input.width as usize;
        self.input.texel(index % width, index / width)
    }

    /// The first of the brightest texels; `None` in a black map.
    fn brightest(&self) -> Option<(usize, f64)> {
        let mut best = (0, 0.0);
        for index in 0..self.input.texels.len() {
            let value = luminance(self.texel(index));
            if value > best.1 {
                best = (index, value);
            }
        }
        (best.1 > 0.0).then_some(best)
    }

    fn solid_angle(&self, index: usize) -> f64 {
        let width = self.input.width as usize;
        self.rows.thickness(index / width) * TAU / width as f64
    }

    fn direction(&self, index: usize) -> DVec3 {
        let width = self.input.width as usize;
        let longitude = ((index % width) as f64 + 0.5) / width as f64 * TAU - PI;
        let y = self.rows.y_within(index / width, 0.5);
        let radius = (1.0 - y * y).max(0.0).sqrt();
        DVec3::new(
            radius * libm::cos(longitude),
            y,
            radius * libm::sin(longitude),
        )
    }

    /// Texels connected to `peak` that are brighter than `least`; `None` where they are too many for a sun.
    fn region(&self, peak: usize, least: f64) -> Option<Vec<usize>> {
        // A cap twice as wide as the largest sun.
        let limit = TAU * (1.0 - libm::cos(2.0 * LARGEST_RADIUS));
        let mut region = vec![peak];
        let mut area = 0.0;
        let mut next = 0;
        while next < region.len() {
            area += self.solid_angle(region[next]);
            if area > limit {
                return None;
            }
            for neighbour in self.neighbours(region[next]) {
                if luminance(self.texel(neighbour)) > least && !region.contains(&neighbour) {
                    region.push(neighbour);
                }
            }
            next += 1;
        }
        Some(region)
    }

    /// The up to eight texels around one; longitude wraps.
    fn neighbours(&self, index: usize) -> Vec<usize> {
        let (width, height) = (self.input.width as usize, self.input.height as usize);
        let (column, row) = (index % width, index / width);
        let rows = row.saturating_sub(1)..(row + 2).min(height);
        rows.flat_map(|y| [width - 1, 0, 1].map(|x| y * width + (column + x) % width))
            .filter(|neighbour| *neighbour != index)
            .collect()
    }

    /// Mean radiance of the texels that touch the region.
    fn surroundings(&self, region: &[usize]) -> Option<[f32; 3]> {
        let mut ring: Vec<usize> = region.iter().flat_map(|&i| self.neighbours(i)).collect();
        ring.sort_unstable();
        ring.dedup();
        ring.retain(|index| !region.contains(index));
        let sum: DVec3 = ring.iter().map(|&index| self.texel(index)).sum();
        (!ring.is_empty()).then(|| to_f32(sum / ring.len() as f64))
    }

    fn light(&self, region: &[usize], surroundings: [f32; 3]) -> Light {
        let mut light = Light {
            energy: DVec3::ZERO,
            moment: DVec3::ZERO,
            squared: 0.0,
            squares: 0.0,
        };
        let around = DVec3::from(surroundings.map(f64::from));
        let mut total = 0.0;
        for &index in region {
            let above = (self.texel(index) - around).max(DVec3::ZERO);
            let angle = self.solid_angle(index);
            let value = luminance(above);
            light.energy += above * angle;
            light.moment += self.direction(index) * (value * angle);
            total += value * angle;
            light.squares += value * value * angle;
        }
        light.squared = total * total;
        light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey sky of 0.5 with one disc of `radiance` and `radius` about `centre`.
    fn sky(width: u32, centre: DVec3, radius: f64, radiance: [f32; 3]) -> Equirect {
        let height = width / 2;
        let rows = Rows::new(height);
        let mut input = Equirect {
            width,
            height,
            texels: vec![[0.5; 3]; (width * height) as usize],
        };
        let map = Map {
            input: &input.clone(),
            rows: &rows,
        };
        for (index, texel) in input.texels.iter_mut().enumerate() {
            if map.direction(index).angle_between(centre) < radius {
                *texel = radiance;
            }
        }
        input
    }

    fn energy_error(before: &Equirect, after: &Equirect, sun: &ExtractedSun) -> f64 {
        let rows = Rows::new(before.height);
        let (full, left) = (before.energy(&rows), after.energy(&rows));
        ((left + sun.energy() - full) / full).abs().max_element()
    }

    #[test]
    fn energy_of_sky_and_sun_is_that_of_the_source() {
        for (centre, radius) in [
            (DVec3::new(0.3, 0.6, -0.7), 0.01),
            (DVec3::new(-1.0, 0.1, 1e-3), 0.02),
            (DVec3::new(0.01, 1.0, 0.02), 0.03),
        ] {
            let centre = centre.normalize();
            let source = sky(1024, centre, radius, [9e5, 1e6, 8e5]);
            let mut left = source.clone();
            let sun = extract(&mut left, &Rows::new(512)).expect("a sun");
            assert!(energy_error(&source, &left, &sun) < 1e-6);
            assert!(left.texels.iter().all(|texel| *texel == [0.5; 3]));
            let found = DVec3::from(sun.direction.map(f64::from));
            assert!(found.angle_between(centre) < 2e-3, "{found}");
            let ratio = f64::from(sun.angular_radius) / radius;
            assert!((0.8..1.2).contains(&ratio), "{ratio}");
            assert!((sun.color[0] - 0.9).abs() < 1e-5 && sun.color[1] == 1.0);
        }
    }

    #[test]
    fn one_texel_is_a_sun() {
        let mut source = sky(512, DVec3::Y, 0.0, [0.0; 3]);
        for index in [100 * 512, 100 * 512 + 511, 37] {
            let mut map = source.clone();
            map.texels[index] = [1e6; 3];
            let lit = map.clone();
            let sun = extract(&mut map, &Rows::new(256)).expect("a sun");
            assert!(energy_error(&lit, &map, &sun) < 1e-6);
            assert!(map.texels.iter().all(|texel| *texel == [0.5; 3]));
        }
        assert_eq!(extract(&mut source, &Rows::new(256)), None);
    }

    #[test]
    fn skies_without_a_sun_stay_as_they_are() {
        let centre = DVec3::new(0.3, 0.6, -0.7).normalize();
        for source in [
            sky(256, centre, 0.01, [100.0; 3]),
            sky(256, centre, 0.2, [1e6; 3]),
            sky(256, centre, 0.0, [0.0; 3]),
            sky(2, centre, 3.0, [1e6; 3]),
            Equirect {
                width: 2,
                height: 1,
                texels: vec![[0.0; 3]; 2],
            },
        ] {
            let mut map = source.clone();
            assert_eq!(extract(&mut map, &Rows::new(source.height)), None);
            assert_eq!(map, source);
        }
    }
}
