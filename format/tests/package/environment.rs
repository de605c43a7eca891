//! Rules of the environment: cubes, sun, coefficients, importance table.

use crate::common::{Content, package, tiny};
use cairn_format::gpu::{EnvAliasEntry, EnvAliasHeader};
use cairn_format::scene::{Environment, IDENTITY_SWIZZLE, Image, ImageRole, Level, Scene, Sun};
use cairn_format::{Package, Result, TextureFormat, features};

/// The tiny package under a grey sky with a sun.
fn lit() -> (Scene, Content) {
    let (mut scene, mut content) = tiny();
    content.texels.resize(64, 0);
    let image = |name: &str, layers: u32, lengths: &[u64]| Image {
        name: name.into(),
        role: ImageRole::Environment,
        format: TextureFormat::Rgb9e5Ufloat,
        swizzle: IDENTITY_SWIZZLE,
        width: 1 << (lengths.len() - 1),
        height: 1 << (lengths.len() - 1),
        layers,
        levels: (lengths.iter())
            .map(|&length| Level { offset: 32, length })
            .collect(),
    };
    let side = cairn_format::brdf_table::BRDF_TABLE_SIZE;
    let table_bytes = u64::from(4 * side * side);
    content.texels.resize(32 + table_bytes as usize, 0);
    scene.images.push(image("cube", 6, &[96, 24]));
    scene.images.push(Image {
        width: side,
        height: side,
        ..image("lut", 1, &[table_bytes])
    });
    scene.brdf_lut = Some(2);
    scene.features |= features::ENVIRONMENT | features::SUN;
    scene.environment = Some(Environment {
        sky: 1,
        irradiance: 1,
        prefiltered: 1,
        prefiltered_roughness: vec![0.0, 1.0],
        scale: 0.5,
        sun: Some(Sun {
            direction: [0.0, 0.6, -0.8],
            color: [1.0, 0.9, 0.8],
            illuminance: 4.0,
            angular_radius: 0.00465,
        }),
        irradiance_sh: [[0.5; 3]; 9],
        source_width: 2,
        source_height: 1,
        replaced_texels: 0,
        clamped_texels: 0,
    });
    content.env_alias = table(4.0 * std::f32::consts::PI, 1.0, 0);
    (scene, content)
}

/// Two hemispheres: the first of luminance `first`, the second of luminance 1 and drawn with its own entry.
fn table(total_luminance: f32, first: f32, alias_index: u32) -> Vec<u8> {
    let header = EnvAliasHeader {
        total_luminance,
        entry_count: 2,
        width: 2,
        height: 1,
    };
    let entry = |luminance, alias_index| EnvAliasEntry {
        prob: 1.0,
        alias_index,
        luminance,
    };
    let entries = [entry(first, alias_index), entry(1.0, 1)];
    [bytemuck::bytes_of(&header), bytemuck::cast_slice(&entries)].concat()
}

fn open(change: impl FnOnce(&mut Scene, &mut Content)) -> Result<Package> {
    let (mut scene, mut content) = lit();
    change(&mut scene, &mut content);
    Package::from_bytes(&package(&scene, &content))
}

#[track_caller]
fn refused(what: &str, change: impl FnOnce(&mut Environment)) {
    let opened = open(|scene, _| change(scene.environment.as_mut().expect("an environment")));
    let error = opened.expect_err(what).to_string();
    assert!(error.contains(what), "`{error}` does not say `{what}`");
}

#[track_caller]
fn bad_sun(change: impl FnOnce(&mut Sun)) {
    refused("the sun's direction", |environment| {
        change(environment.sun.as_mut().expect("a sun"));
    });
}

#[test]
fn a_sound_environment_is_read() {
    let package = open(|_, _| ()).expect("a good package");
    package.verify().expect("a sound package");
    let (header, entries) = package.env_alias().expect("read").expect("a table");
    assert_eq!((header.width, header.height, entries.len()), (2, 1, 2));
    let without = open(|_, content| content.env_alias.clear()).expect("no table is needed");
    assert!(without.env_alias().expect("read").is_none());
}

#[test]
fn environments_are_checked() {
    refused("image 0 is no cube", |environment| environment.sky = 0);
    refused("scale 0", |environment| environment.scale = 0.0);
    refused("scale inf", |environment| environment.scale = f32::INFINITY);
    refused("1 roughnesses of 2 levels", |environment| {
        environment.prefiltered_roughness.pop();
    });
    refused("roughness 0.5, not 1", |environment| {
        environment.prefiltered_roughness[1] = 0.5;
    });
    refused("coefficient", |environment| {
        environment.irradiance_sh[8][2] = f32::NAN;
    });
    refused("feature bit", |environment| environment.sun = None);
    let error = |change: fn(&mut Scene)| {
        let opened = open(|scene, _| change(scene));
        opened.expect_err("an error").to_string()
    };
    assert!(error(|scene| scene.brdf_lut = None).contains("without a BRDF table"));
    // The cube's second level is one texel, as a table must not be.
    let small = |scene: &mut Scene| {
        scene.images[2].width = 1;
        scene.images[2].height = 1;
        scene.images[2].levels[0].length = 4;
    };
    assert!(error(small).contains("not 64 texels a side"));
    assert!(error(|scene| scene.environment = None).contains("importance table without"));
}

#[test]
fn suns_are_checked() {
    bad_sun(|sun| sun.direction = [0.0, 0.6, -0.9]);
    bad_sun(|sun| sun.color[0] = 2.0);
    bad_sun(|sun| sun.color[0] = 0.99);
    bad_sun(|sun| sun.illuminance = 0.0);
    bad_sun(|sun| sun.illuminance = f32::NAN);
    bad_sun(|sun| sun.angular_radius = 0.0);
    bad_sun(|sun| sun.angular_radius = 2.0);
}

#[test]
fn importance_tables_are_checked() {
    let words = open(|_, content| content.env_alias.truncate(20)).expect_err("five words");
    assert!(words.to_string().contains("5 words"), "{words}");
    let pi = std::f32::consts::PI;
    for (what, bytes) in [
        ("density", table(4.1 * pi, 1.0, 0)),
        ("density", table(4.0 * pi, 1.001, 0)),
        ("density", table(5.0 * pi, 1.5, 0)),
        ("entry 0", table(4.0 * pi, -1.0, 0)),
        ("entry 0", table(4.0 * pi, f32::NAN, 0)),
        ("entry 0", table(4.0 * pi, 1.0, 2)),
        ("total luminance", table(0.0, 1.0, 0)),
        ("cells", table(4.0 * pi, 1.0, 0)[..28].to_vec()),
    ] {
        let package =
            open(|_, content| content.env_alias = bytes).expect("open reads no bulk data");
        let error = package.verify().expect_err(what).to_string();
        assert!(error.contains(what), "`{error}` does not say `{what}`");
    }
}
