//! The table is sound, and JSON and flags follow it.

use std::collections::BTreeSet;

use clap::{Args, FromArgMatches};
use proptest::prelude::*;

use super::flags::{SettingFlags, flag_name};
use super::json::SettingsError;
use super::table::{Kind, Value};
use super::*;

fn from_flags(arguments: &[&str]) -> Result<Settings, clap::Error> {
    let command = SettingFlags::augment_args(clap::Command::new("p"));
    let matches = command.try_get_matches_from([&["p"], arguments].concat())?;
    let mut settings = Settings::default();
    SettingFlags::from_arg_matches(&matches)?.apply(&mut settings);
    Ok(settings)
}

/// A value within `kind`, picked by `seed`.
fn pick(kind: &Kind, seed: u32) -> Value {
    let fraction = (seed % 1001) as f32 / 1000.0;
    let between = |least: f32, most: f32| (least + (most - least) * fraction).clamp(least, most);
    match *kind {
        Kind::Switch => Value::Switch(seed.is_multiple_of(2)),
        Kind::Integer(least, most) => Value::Integer(least + seed % (most - least + 1)),
        Kind::OneOf(values) => Value::Integer(values[seed as usize % values.len()]),
        Kind::Number(least, most) => Value::Number(between(least, most)),
        Kind::Degrees(least, most) => Value::Number(between(least.to_radians(), most.to_radians())),
        Kind::Choice(choices) => Value::Choice(choices[seed as usize % choices.len()].name),
    }
}

fn shuffled(seeds: &[u32]) -> Settings {
    let mut settings = Settings::default();
    for ((place, _, field), seed) in settings.places().into_iter().zip(seeds.iter().cycle()) {
        assert!(
            settings.set(place, pick(&field.kind, *seed)),
            "{}",
            field.name
        );
    }
    settings
}

#[test]
fn every_default_is_allowed_and_every_name_is_one_flag() {
    let settings = Settings::default();
    let mut names = BTreeSet::new();
    for (place, group, field) in settings.places() {
        assert!(
            field.kind.allows(settings.get(place)),
            "{group}.{}",
            field.name
        );
        assert!(field.doc.len() > 3, "{group}.{} has no help", field.name);
        let name = flag_name(group, field.name);
        assert!(names.insert(format!("no-{name}")) && names.insert(name));
    }
    assert!(names.len() > 60, "{names:?}");
}

#[test]
fn values_of_another_type_or_range_are_refused() {
    let mut settings = Settings::default();
    let before = settings.clone();
    for (place, _, field) in settings.places() {
        let bad = match field.kind {
            Kind::Switch => vec![Value::Integer(1)],
            Kind::Integer(least, most) => {
                vec![
                    Value::Integer(most + 1),
                    Value::Integer(least.wrapping_sub(1)),
                    Value::Number(1.0),
                ]
            }
            Kind::OneOf(_) => vec![Value::Integer(3)],
            Kind::Number(least, most) => {
                vec![
                    Value::Number(f32::NAN),
                    Value::Number(least - 1.0),
                    Value::Number(most * 1.01 + 1.0),
                ]
            }
            Kind::Degrees(..) => vec![Value::Number(f32::INFINITY), Value::Number(7.0)],
            Kind::Choice(_) => vec![Value::Choice("nonsense"), Value::Switch(true)],
        };
        for value in bad {
            assert!(!settings.set(place, value), "{}: {value:?}", field.name);
        }
    }
    assert_eq!(settings, before);
}

proptest! {
    #[test]
    fn json_brings_every_bit_back(seeds in prop::collection::vec(any::<u32>(), 50)) {
        let settings = shuffled(&seeds);
        let text = settings.to_json().to_string();
        let mut read = Settings::default();
        read.merge_json(&serde_json::from_str(&text).expect("JSON")).expect("allowed");
        prop_assert_eq!(read, settings);
    }

    #[test]
    fn flags_bring_every_value_back(seeds in prop::collection::vec(any::<u32>(), 50)) {
        let settings = shuffled(&seeds);
        let mut arguments = Vec::new();
        for (place, group, field) in settings.places() {
            let name = flag_name(group, field.name);
            match settings.get(place) {
                Value::Switch(true) => arguments.push(format!("--{name}")),
                Value::Switch(false) => arguments.push(format!("--no-{name}")),
                value => arguments.push(format!("--{name}={}", value.to_text(&field.kind))),
            }
        }
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let read = from_flags(&arguments).expect("flags");
        for (place, _, field) in settings.places() {
            match (settings.get(place), read.get(place)) {
                // Degrees are written with five decimals.
                (Value::Number(a), Value::Number(b)) => {
                    prop_assert!((a - b).abs() <= 2e-7 * a.abs().max(1.0), "{}: {} {}", field.name, a, b);
                }
                (a, b) => prop_assert_eq!(a, b),
            }
        }
    }
}

#[test]
fn errors_name_the_field_and_its_range() {
    let error = |json: &str| {
        let mut settings = Settings::default();
        let result = settings.merge_json(&serde_json::from_str(json).expect("JSON"));
        assert_eq!(settings, Settings::default(), "{json}");
        result.expect_err(json)
    };
    let text = error(r#"{"ev": 1, "shadow": {"cascades": 5}}"#).to_string();
    assert!(
        text.contains("`shadow.cascades` is 5") && text.contains("1 to 4"),
        "{text}"
    );
    let text = error(r#"{"shadow": {"resolution": 1000}}"#).to_string();
    assert!(text.contains("512, 1024, 2048, 4096"), "{text}");
    let text = error(r#"{"tonemap": "ACES"}"#).to_string();
    assert!(
        text.contains("`tonemap`") && text.contains("aces, linear, agx, neutral"),
        "{text}"
    );
    let text = error(r#"{"shadow": {"sharpness": 1}}"#).to_string();
    assert!(
        text.contains("no setting `shadow.sharpness`") && text.contains("pcf_radius"),
        "{text}"
    );
    let text = error(r#"{"ibl_yaw": 7}"#).to_string();
    assert!(text.contains("radians"), "{text}");
    assert_eq!(
        error(r#"{"ao": 1}"#),
        SettingsError::NotAnObject("ao".into())
    );
    assert!(matches!(
        error(r#"{"msaa": 2.5}"#),
        SettingsError::NotAllowed { .. }
    ));
    assert!(matches!(error("[]"), SettingsError::NotAnObject(_)));
}

#[test]
fn flags_are_checked_and_angles_are_degrees() {
    let settings = from_flags(&[
        "--ibl-yaw",
        "-90",
        "--no-skybox",
        "--ev=-1",
        "--msaa",
        "4",
        "--no-shadow",
    ]);
    let settings = settings.expect("flags");
    assert!((settings.ibl_yaw + std::f32::consts::FRAC_PI_2).abs() < 1e-6);
    assert!(!settings.skybox && !settings.shadow.enabled);
    assert_eq!((settings.ev, settings.msaa), (-1.0, 4));
    for (arguments, expected) in [
        (["--msaa", "3"], "1, 2, 4, 8"),
        (["--shadow-cascades", "0"], "1 to 4"),
        (["--ev", "nan"], "-64 to 64"),
        (["--brdf", "x"], "energy, gltf-core"),
    ] {
        let text = from_flags(&arguments).expect_err("not allowed").to_string();
        assert!(
            text.contains(expected) && text.contains(arguments[0]),
            "{text}"
        );
    }
}
