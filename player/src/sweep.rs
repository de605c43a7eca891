//! `cairn-player sweep`: what each feature and quality level costs, and how far the picture then is from a reference.

pub mod plot;

use std::path::PathBuf;

use cairn_format::Package;
use serde::Serialize;

use crate::PlayerError;
use crate::bench::{self, DROPPED};
use crate::camera::Camera;
use crate::gpu::Gpu;
use crate::headless::Session;
use crate::metrics::{Difference, Picture, difference, display, flip};
use crate::ruler::{Ruler, Stored, read, session_picture};
use crate::settings::table::{Kind, Value};
use crate::settings::{Place, Settings};

/// Whole numbers with a wider range than this are stepped by doubling.
const FEW: u32 = 8;

/// Settings of other levels only show where another setting has this value.
const NEEDS: [(&str, &str, &str); 2] = [
    ("shadow.quality", "shadow.filter", "pcss"),
    ("shadow.early_out", "shadow.filter", "pcss"),
];

/// What changes the picture's meaning and not its quality, or bounds what is in metres.
const LEFT_OUT: [&str; 6] = ["mode", "tonemap", "debug_view", "skybox", "light", "path"];

/// What to sweep.
#[derive(Clone, Debug)]
pub struct SweepOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// Viewpoint.
    pub camera: Camera,
    /// The base that one setting at a time is changed of.
    pub settings: Settings,
    /// Measured frames of each level.
    pub frames: u32,
    /// A picture to measure against; the device's best where absent: see [`Ruler::best`].
    pub reference: Option<PathBuf>,
    /// Samples per pixel of that.
    pub samples: u32,
}

/// One level of one setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// `base`, or the setting.
    pub setting: String,
    /// Its value.
    pub value: String,
    /// Whether this is the base's own value.
    pub base: bool,
    /// Median GPU milliseconds of a frame; `None` without timestamps.
    pub gpu_ms: Option<f64>,
    /// Median CPU milliseconds of recording it.
    pub record_ms: f64,
    #[serde(flatten)]
    pub error: Difference,
    /// Mean FLIP of the display values.
    pub flip: f64,
}

/// All levels, and what they depend on.
#[derive(Clone, Debug, Serialize)]
pub struct SweepReport {
    #[serde(flatten)]
    pub origin: bench::Origin,
    pub reference: String,
    pub levels: Vec<Level>,
}

/// A level before it is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    pub setting: String,
    pub value: String,
    pub base: bool,
    pub settings: Settings,
}

/// The base, then every level of every setting that is about quality, one changed at a time.
pub fn candidates(base: &Settings) -> Vec<Candidate> {
    let mut all = vec![Candidate {
        setting: "base".into(),
        value: String::new(),
        base: true,
        settings: base.clone(),
    }];
    let places = base.places();
    for (place, group, field) in &places {
        let name = if group.is_empty() {
            field.name.into()
        } else {
            format!("{group}.{}", field.name)
        };
        if LEFT_OUT.iter().any(|out| *out == name || out == group) {
            continue;
        }
        for value in levels(&field.kind) {
            let mut settings = base.clone();
            require(&mut settings, &name, &places);
            settings.set(*place, value);
            all.push(Candidate {
                setting: name.clone(),
                value: value.to_text(&field.kind),
                base: base.get(*place) == value && settings == *base,
                settings,
            });
        }
    }
    all
}

type Entry = (Place, &'static str, &'static crate::settings::table::Field);

fn require(settings: &mut Settings, name: &str, places: &[Entry]) {
    for (_, needed, value) in NEEDS.iter().filter(|(of, ..)| *of == name) {
        let found = places
            .iter()
            .find(|(_, group, field)| format!("{group}.{}", field.name) == *needed);
        if let Some((place, _, field)) = found
            && let Ok(value) = field.kind.parse(value)
        {
            settings.set(*place, value);
        }
    }
}

/// Values worth comparing; none of a kind that is measured in metres or radians.
fn levels(kind: &Kind) -> Vec<Value> {
    match *kind {
        Kind::Switch => [false, true].map(Value::Switch).into(),
        Kind::OneOf(values) => values.iter().copied().map(Value::Integer).collect(),
        Kind::Choice(choices) => choices
            .iter()
            .map(|choice| Value::Choice(choice.name))
            .collect(),
        Kind::Integer(least, most) if most - least < FEW => {
            (least..=most).map(Value::Integer).collect()
        }
        Kind::Integer(least, most) => {
            let doubled = std::iter::successors(Some(least.max(1)), |value| value.checked_mul(2));
            doubled
                .take_while(|value| *value <= most)
                .map(Value::Integer)
                .collect()
        }
        Kind::Number(..) | Kind::Degrees(..) => Vec::new(),
    }
}

/// Measures every level.
///
/// # Errors
/// [`PlayerError::Input`] for a reference that cannot be read or has another size; failures of Vulkan.
pub fn run(
    gpu: &Gpu,
    package: &Package,
    options: &SweepOptions,
) -> Result<SweepReport, PlayerError> {
    let (reference, name) = reference(gpu, package, options)?;
    let candidates = candidates(&options.settings);
    let mut session = Session::new(gpu, package, options.size, &options.settings, true)?;
    let mut levels = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        levels.push(measure(&mut session, options, &reference, candidate)?);
    }
    Ok(SweepReport {
        origin: bench::Origin::new(gpu, package, options.size, &options.settings),
        reference: name,
        levels,
    })
}

fn reference(
    gpu: &Gpu,
    package: &Package,
    options: &SweepOptions,
) -> Result<(Stored, String), PlayerError> {
    let (size, settings) = (options.size, &options.settings);
    let Some(file) = &options.reference else {
        let ruler = Ruler::best(gpu, options.samples, size);
        let picture = ruler.picture(gpu, package, size, &options.camera, settings)?;
        return Ok((Stored::Radiance(picture), ruler.name()));
    };
    let stored = read(file)?;
    let (Stored::Radiance(picture) | Stored::Display(picture)) = &stored;
    if [picture.width, picture.height] != size.map(|side| side as usize) {
        return Err(PlayerError::Input(format!(
            "{}: {}x{}, but the picture is {}x{}: use --size",
            file.display(),
            picture.width,
            picture.height,
            size[0],
            size[1]
        )));
    }
    Ok((stored, file.display().to_string()))
}

fn measure(
    session: &mut Session<'_>,
    options: &SweepOptions,
    reference: &Stored,
    candidate: Candidate,
) -> Result<Level, PlayerError> {
    let (mut gpu, mut record) = (Vec::new(), Vec::new());
    let total = DROPPED + options.frames.max(1);
    for index in 0..total {
        let last = index + 1 == total;
        let seconds = session.frame(&options.camera, &candidate.settings, last)?;
        if index >= DROPPED {
            record.push(seconds * 1e3);
        }
        if index > DROPPED {
            push_total(&mut gpu, session);
        }
    }
    session.finish()?;
    // The last frame's copies are passes of their own, so it is only the picture.
    if gpu.is_empty() {
        push_total(&mut gpu, session);
    }
    let radiance = session_picture(session, options.size)?;
    let (error, flip) = errors(&radiance, reference, &candidate.settings);
    Ok(Level {
        setting: candidate.setting,
        value: candidate.value,
        base: candidate.base,
        gpu_ms: median(gpu),
        record_ms: median(record).unwrap_or_default(),
        error,
        flip,
    })
}

fn push_total(times: &mut Vec<f64>, session: &Session<'_>) {
    let passes = session.timings();
    if !passes.is_empty() {
        times.push(passes.iter().map(|pass| pass.milliseconds).sum());
    }
}

fn median(mut times: Vec<f64>) -> Option<f64> {
    times.sort_unstable_by(f64::total_cmp);
    times.get(times.len() / 2).copied()
}

/// Differences of radiance where the reference is radiance, of display values otherwise; FLIP of display values.
///
/// # Panics
/// Where the sizes differ, which was checked.
pub fn errors(radiance: &Picture, reference: &Stored, settings: &Settings) -> (Difference, f64) {
    let shown = display::display(radiance, settings);
    let (error, target) = match reference {
        Stored::Radiance(reference) => (
            difference(radiance, reference),
            display::display(reference, settings),
        ),
        Stored::Display(reference) => (difference(&shown, reference), reference.clone()),
    };
    let map = flip::ldr(&shown, &target, flip::PIXELS_PER_DEGREE);
    match (error, map) {
        (Ok(error), Ok(map)) => (error, map.mean()),
        (Err(wrong), _) | (_, Err(wrong)) => panic!("{wrong}"),
    }
}

impl SweepReport {
    /// A table for people.
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut text = format!("{} against {}\n", self.origin.device, self.reference);
        let _ = writeln!(
            text,
            "{:<28}{:>10}{:>10}{:>10}{:>10}{:>10}",
            "", "GPU ms", "CPU ms", "RMSE", "relative", "FLIP"
        );
        for level in &self.levels {
            let gpu = level.gpu_ms.map_or("-".into(), |ms| format!("{ms:.3}"));
            let name = format!(
                "{} {}{}",
                level.setting,
                level.value,
                if level.base { " *" } else { "" }
            );
            let _ = writeln!(
                text,
                "{name:<28}{gpu:>10}{:>10.3}{:>10.5}{:>10.5}{:>10.5}",
                level.record_ms, level.error.rmse, level.error.relative, level.flip
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_of_quality_is_a_candidate() {
        let all = candidates(&Settings::default());
        let values = |setting: &str| -> Vec<&str> {
            let of = all.iter().filter(|candidate| candidate.setting == setting);
            of.map(|candidate| candidate.value.as_str()).collect()
        };
        assert_eq!(values("msaa"), ["1", "2", "4", "8"]);
        assert_eq!(values("shadow.enabled"), ["false", "true"]);
        assert_eq!(values("shadow.cascades"), ["1", "2", "3", "4"]);
        assert_eq!(values("ao.directions"), ["1", "2", "4", "8", "16"]);
        assert!(values("tonemap").is_empty() && values("light.source").is_empty());
        let soft = all
            .iter()
            .find(|candidate| candidate.setting == "shadow.quality")
            .expect("a level");
        assert_eq!(
            soft.settings.shadow.filter,
            crate::settings::ShadowFilter::Pcss
        );
        assert!(all.iter().filter(|candidate| candidate.base).count() > 10);
    }
}
