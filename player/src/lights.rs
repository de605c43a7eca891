//! Directional lights of a frame: those of the scene, the environment's sun, or a fallback light.
//!
//! Light 0 is the one that a shadow map and contact shadows belong to: where some light casts shadows, the first that
//! does is moved to the front.

use cairn_format::gpu::DirectionalLight;
use cairn_format::scene::{ArchivedSun, natives};
use cairn_format::{Error, Package, Part, SectionKind};
use glam::{Mat3, Vec3};

use crate::PlayerError;
use crate::settings::{LightSource, Settings};

/// The directional lights that a package offers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneLights {
    scene: Vec<DirectionalLight>,
    sun: Option<Sun>,
    /// There is light without directional ones: an environment, point or spot lights.
    lit: bool,
}

/// The sun of an environment, before its yaw.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sun {
    /// Unit, towards the sun.
    direction: Vec3,
    color: Vec3,
    /// In the environment's units, which `ibl_intensity` scales.
    illuminance: f32,
    angular_radius: f32,
}

/// The environment's sun as rays see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunDisc {
    /// Unit, from the scene to the sun.
    pub direction: [f32; 3],
    /// Squared sine of the angular radius.
    pub sin2: f32,
    /// Radiance of the disc.
    pub radiance: [f32; 3],
}

/// Least angular radius of a sun that rays can meet, radians.
const MIN_SUN_RADIUS: f32 = 1e-4;

/// The lights that shine in a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lights {
    /// Records for the GPU, the shadowed light first.
    pub records: Vec<DirectionalLight>,
    /// The light that casts shadows: the first record.
    pub shadowed: Option<Shadowed>,
}

/// What a shadow map needs to know of its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadowed {
    /// Unit direction of travel.
    pub direction: Vec3,
    /// Radians.
    pub angular_diameter: f32,
}

impl SceneLights {
    /// Copies the lights out of a package.
    ///
    /// # Errors
    /// Those that are not finite, or shine nowhere.
    pub fn new(package: &Package) -> Result<Self, PlayerError> {
        let records = package.directional_lights()?;
        for (index, record) in records.iter().enumerate() {
            check(record, index)?;
        }
        let environment = package.scene().environment.as_ref();
        Ok(Self {
            scene: records.to_vec(),
            sun: environment.and_then(|found| found.sun.as_ref().map(Sun::new)),
            lit: environment.is_some() || !package.punctual_lights()?.is_empty(),
        })
    }

    /// Most lights that a frame can have.
    pub fn capacity(&self) -> usize {
        self.scene.len().max(1)
    }

    /// How many lights shine, and whether one of them casts shadows.
    pub fn count(&self, settings: &Settings) -> (usize, bool) {
        let casts = |record: &DirectionalLight| record.color_and_shadow[3] > 0.0;
        match self.source(settings.light.source) {
            LightSource::Scene => (self.scene.len(), self.scene.iter().any(casts)),
            LightSource::Sun => (usize::from(self.sun.is_some()), self.sun.is_some()),
            LightSource::Fallback => (1, true),
            LightSource::Auto | LightSource::None => (0, false),
        }
    }

    /// Replaces `lights` by those that shine with these settings.
    pub fn choose(&self, settings: &Settings, lights: &mut Lights) {
        lights.records.clear();
        let mut angular_diameter = settings.shadow.angular_diameter;
        match self.source(settings.light.source) {
            LightSource::Scene => lights.records.extend_from_slice(&self.scene),
            LightSource::Sun => {
                if let Some(sun) = &self.sun {
                    angular_diameter = sun.angular_radius * 2.0;
                    lights.records.push(sun.record(settings));
                }
            }
            LightSource::Fallback => lights.records.push(fallback(settings)),
            LightSource::Auto | LightSource::None => {}
        }
        let casts = |record: &DirectionalLight| record.color_and_shadow[3] > 0.0;
        let caster = lights.records.iter().position(casts);
        if let Some(caster) = caster {
            // The others keep their order.
            lights.records[..=caster].rotate_right(1);
        }
        lights.shadowed = caster.map(|_| {
            let [x, y, z, _] = lights.records[0].direction_and_intensity;
            Shadowed {
                direction: Vec3::new(x, y, z).normalize(),
                angular_diameter,
            }
        });
    }

    /// The environment's sun, where it is the light that shines.
    pub fn sun_disc(&self, settings: &Settings) -> Option<SunDisc> {
        let sun = self.sun.as_ref()?;
        if self.source(settings.light.source) != LightSource::Sun {
            return None;
        }
        let sine = sun.angular_radius.max(MIN_SUN_RADIUS).sin();
        let record = sun.record(settings);
        let [x, y, z, illuminance] = record.direction_and_intensity;
        let radiance = illuminance / (std::f32::consts::PI * sine * sine);
        Some(SunDisc {
            direction: [-x, -y, -z],
            sin2: sine * sine,
            radiance: (sun.color * radiance).to_array(),
        })
    }

    /// Resolves [`LightSource::Auto`].
    fn source(&self, wanted: LightSource) -> LightSource {
        match wanted {
            LightSource::Auto if !self.scene.is_empty() => LightSource::Scene,
            LightSource::Auto if self.sun.is_some() => LightSource::Sun,
            LightSource::Auto if self.lit => LightSource::None,
            LightSource::Auto => LightSource::Fallback,
            other => other,
        }
    }
}

impl Sun {
    fn new(sun: &ArchivedSun) -> Self {
        Self {
            direction: Vec3::from(natives(&sun.direction)),
            color: Vec3::from(natives(&sun.color)),
            illuminance: sun.illuminance.to_native(),
            angular_radius: sun.angular_radius.to_native(),
        }
    }

    fn record(&self, settings: &Settings) -> DirectionalLight {
        let direction = -(Mat3::from_rotation_y(-settings.ibl_yaw) * self.direction);
        let intensity = self.illuminance * settings.ibl_intensity;
        DirectionalLight {
            direction_and_intensity: direction.extend(intensity).to_array(),
            color_and_shadow: self.color.extend(1.0).to_array(),
        }
    }
}

fn fallback(settings: &Settings) -> DirectionalLight {
    let light = &settings.light;
    let turn = Mat3::from_rotation_y(light.yaw) * Mat3::from_rotation_x(light.pitch);
    DirectionalLight {
        direction_and_intensity: (turn * Vec3::NEG_Z).extend(light.intensity).to_array(),
        color_and_shadow: [1.0; 4],
    }
}

fn check(record: &DirectionalLight, index: usize) -> Result<(), PlayerError> {
    let values = [record.direction_and_intensity, record.color_and_shadow];
    let [x, y, z, _] = record.direction_and_intensity;
    let what = if !values.as_flattened().iter().all(|value| value.is_finite()) {
        "a light is not finite"
    } else if Vec3::new(x, y, z).try_normalize().is_none() {
        "a light has no direction"
    } else {
        return Ok(());
    };
    let kind = SectionKind::DirectionalLights;
    let offset = (index * size_of::<DirectionalLight>()) as u64;
    Err(Error::corrupt(Part::Section(kind), offset, what).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::LightSettings;

    fn light(direction: Vec3, casts: bool) -> DirectionalLight {
        DirectionalLight {
            direction_and_intensity: direction.extend(2.0).to_array(),
            color_and_shadow: [1.0, 1.0, 1.0, f32::from(u8::from(casts))],
        }
    }

    fn from(source: LightSource) -> Settings {
        Settings {
            light: LightSettings {
                source,
                ..LightSettings::default()
            },
            ..Settings::default()
        }
    }

    fn sun() -> Sun {
        Sun {
            direction: Vec3::new(0.6, 0.8, 0.0),
            color: Vec3::new(1.0, 0.9, 0.8),
            illuminance: 50.0,
            angular_radius: 0.01,
        }
    }

    fn chosen(lights: &SceneLights, settings: &Settings) -> Lights {
        let mut found = Lights::default();
        lights.choose(settings, &mut found);
        let (count, casts) = lights.count(settings);
        assert_eq!(
            (found.records.len(), found.shadowed.is_some()),
            (count, casts)
        );
        assert!(count <= lights.capacity());
        found
    }

    #[test]
    fn the_first_that_casts_comes_first() {
        let lights = SceneLights {
            scene: vec![
                light(Vec3::X, false),
                light(Vec3::Y, false),
                light(Vec3::NEG_Y, true),
                light(Vec3::Z, true),
            ],
            ..SceneLights::default()
        };
        let found = chosen(&lights, &Settings::default());
        let order: Vec<_> = found
            .records
            .iter()
            .map(|record| record.direction_and_intensity)
            .collect();
        let expected = [Vec3::NEG_Y, Vec3::X, Vec3::Y, Vec3::Z];
        assert_eq!(order, expected.map(|axis| axis.extend(2.0).to_array()));
        assert_eq!(
            found.shadowed.map(|light| light.direction),
            Some(Vec3::NEG_Y)
        );
    }

    #[test]
    fn lights_that_do_not_cast_keep_their_order() {
        let scene = vec![light(Vec3::X, false), light(Vec3::Y, false)];
        let lights = SceneLights {
            scene: scene.clone(),
            ..SceneLights::default()
        };
        let found = chosen(&lights, &Settings::default());
        assert_eq!((found.records, found.shadowed), (scene, None));
    }

    #[test]
    fn auto_takes_scene_then_sun_then_fallback() {
        let auto = from(LightSource::Auto);
        let mut lights = SceneLights::default();
        let fallback = chosen(&lights, &from(LightSource::Fallback));
        assert_eq!(chosen(&lights, &auto), fallback);
        lights.lit = true;
        assert!(chosen(&lights, &auto).records.is_empty());
        lights.sun = Some(sun());
        assert_eq!(
            chosen(&lights, &auto),
            chosen(&lights, &from(LightSource::Sun))
        );
        lights.scene = vec![light(Vec3::X, true)];
        assert_eq!(chosen(&lights, &auto).records, lights.scene);
        assert!(chosen(&lights, &from(LightSource::None)).records.is_empty());
    }

    #[test]
    fn the_fallback_light_follows_its_angles() {
        let mut settings = from(LightSource::Fallback);
        (settings.light.yaw, settings.light.pitch) = (0.0, 0.0);
        let shadowed = |settings: &Settings| {
            let found = chosen(&SceneLights::default(), settings);
            found.shadowed.map_or(Vec3::ZERO, |light| light.direction)
        };
        assert_eq!(shadowed(&settings), Vec3::NEG_Z);
        settings.light.pitch = -std::f32::consts::FRAC_PI_2;
        assert!(shadowed(&settings).abs_diff_eq(Vec3::NEG_Y, 1e-6));
        (settings.light.yaw, settings.light.pitch) = (std::f32::consts::FRAC_PI_2, 0.0);
        assert!(shadowed(&settings).abs_diff_eq(Vec3::NEG_X, 1e-6));
    }

    /// The sun turns with the sky: `to_environment` of the way back to it is the direction that the bake stored.
    #[test]
    fn the_sun_turns_with_its_environment() {
        let lights = SceneLights {
            sun: Some(sun()),
            lit: true,
            ..SceneLights::default()
        };
        let settings = Settings {
            ibl_yaw: 0.8,
            ibl_intensity: 0.5,
            ..from(LightSource::Sun)
        };
        let found = chosen(&lights, &settings);
        let to_sun = -found.shadowed.map_or(Vec3::ZERO, |light| light.direction);
        let (s, c) = settings.ibl_yaw.sin_cos();
        let in_environment = Vec3::new(
            c * to_sun.x + s * to_sun.z,
            to_sun.y,
            c * to_sun.z - s * to_sun.x,
        );
        assert!(in_environment.abs_diff_eq(sun().direction, 1e-6));
        assert_eq!(found.records[0].direction_and_intensity[3], 25.0);
        let diameter = found.shadowed.map(|light| light.angular_diameter);
        assert_eq!(diameter, Some(0.02));
    }
}
