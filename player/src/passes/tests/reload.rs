//! Shaders that change on disk: the picture follows, and a mistake changes nothing but is told.

use std::fs;
use std::path::Path;

use cairn_shaders::reload::Watch;
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, sphere};
use super::renderer::Stage;
use super::{device, plain};
use crate::gpu::Frames;
use crate::reload::take;
use crate::scene::GpuScene;
use crate::settings::{Settings, Shading};

/// Copies the shaders, whose crate lies beside this one.
fn copy_shaders(to: &Path) {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shaders");
    for folder in ["common", "pathtrace", "raster", "tests"] {
        fs::create_dir(to.join(folder)).expect("a folder");
        for entry in fs::read_dir(from.join(folder)).expect("sources") {
            let path = entry.expect("a source").path();
            let name = path.file_name().expect("a name");
            fs::copy(&path, to.join(folder).join(name)).expect("copied");
        }
    }
}

#[test]
fn shaders_are_reloaded_and_mistakes_keep_the_old_ones() {
    let Some(gpu) = device() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    copy_shaders(folder.path());
    let mut watch = Watch::new(folder.path()).expect("a watch");
    let package = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY])],
        materials: vec![Default::default()],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        ..Fixture::default()
    }
    .package();
    let scene = GpuScene::upload(&gpu, &package).expect("uploads");
    let mut stage = Stage {
        gpu: &gpu,
        package: &package,
        scene: &scene,
        frames: Frames::new(&gpu).expect("frames"),
    };
    let settings = Settings {
        shading: Shading::Forward,
        ..plain()
    };
    let size = [16, 16];
    let mut renderer = stage.renderer(size, &settings);
    let first = stage.draw(&mut renderer, size, &settings);
    assert_eq!(
        take(&mut watch, &mut renderer),
        Ok(false),
        "nothing changed"
    );

    let file = folder.path().join("raster/forward.frag");
    let source = fs::read_to_string(&file).expect("read");
    let at = source.rfind('}').expect("the end of main");
    let broken = format!("{}\n    nonsense;\n}}\n", &source[..at]);
    let line = broken[..broken.find("nonsense").expect("there")]
        .lines()
        .count();
    fs::write(&file, broken).expect("written");
    let error = take(&mut watch, &mut renderer).expect_err("a mistake");
    let place = format!("forward.frag:{line}:");
    assert!(error.contains(&place), "{place} in {error}");
    assert_eq!(stage.draw(&mut renderer, size, &settings), first);
    assert_eq!(take(&mut watch, &mut renderer), Ok(false), "told once");

    let fixed = format!("{}\n    out_color.rgb *= 0.25;\n}}\n", &source[..at]);
    fs::write(&file, fixed).expect("written");
    assert_eq!(take(&mut watch, &mut renderer), Ok(true));
    let second = stage.draw(&mut renderer, size, &settings);
    assert_ne!(second, first, "the change shows");

    // Every entry point is compiled where an included file changes: also the one that goes back.
    let common = folder.path().join("common/constants.glsl");
    let constants = fs::read_to_string(&common).expect("read");
    fs::write(&common, format!("{constants}\nnonsense\n")).expect("written");
    let error = take(&mut watch, &mut renderer).expect_err("a mistake");
    assert!(error.contains("constants.glsl:"), "{error}");
    assert_eq!(stage.draw(&mut renderer, size, &settings), second);
    fs::write(&common, constants).expect("written");
    fs::write(&file, source).expect("written");
    assert_eq!(take(&mut watch, &mut renderer), Ok(true));
    assert_eq!(stage.draw(&mut renderer, size, &settings), first);
}
