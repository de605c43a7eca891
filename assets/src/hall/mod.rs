//! The hall: an open stone hall with cloth, metal spheres, glass, plants and lamps.

pub mod architecture;
pub mod palette;
pub mod props;
pub mod textures;

use glam::Vec3;

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Placement};
use crate::texture::Image;
use palette::Palette;

/// Distance of the column rows from the middle, in metres.
pub const COLUMN_ROW: f32 = 3.4;
/// Length of one bay between columns, in metres.
pub const BAY: f32 = 2.5;

/// `hall/hall.gltf`, its buffer and its textures.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let palette = Palette::new(&mut scene);
    architecture::build(&mut scene, &palette);
    props::build(&mut scene, &palette);
    cameras(&mut scene);
    let (text, buffer) = scene.finish("hall", BufferPlace::File("hall.bin"));
    let mut files = vec![
        OutputFile::new("hall/hall.gltf", text),
        OutputFile::new("hall/hall.bin", buffer),
    ];
    for (name, image) in images() {
        let path = format!("hall/textures/{name}.png");
        files.push(OutputFile::new(path, image.encode_png()));
    }
    files
}

fn cameras(scene: &mut Builder) {
    let views = [
        ("hero", 50.0, [0.35, 1.62, 9.2], [-0.15, 1.95, -4.0]),
        ("detail", 34.0, [-0.15, 1.75, 4.6], [-1.95, 1.2, 1.2]),
        ("plant", 38.0, [-0.75, 1.35, 7.1], [-2.45, 0.95, 4.9]),
    ];
    for (name, yfov, eye, target) in views {
        let at = Placement::looking(Vec3::from_array(eye), Vec3::from_array(target));
        scene.perspective(name, yfov, at);
    }
}

/// Every texture by file name, in a fixed order.
pub fn images() -> Vec<(&'static str, Image)> {
    use textures as t;
    let normals =
        |size: usize, height: fn(f64, f64) -> f64| Image::normals_from_height(size, height);
    vec![
        ("floor_color", t::floor_color()),
        ("floor_normal", normals(512, t::floor_height)),
        ("floor_orm", t::floor_orm()),
        ("wall_color", t::wall_color()),
        ("wall_normal", normals(512, t::wall_height)),
        ("wall_orm", t::wall_orm()),
        ("limestone_color", t::limestone_color()),
        ("limestone_normal", normals(256, t::limestone_height)),
        ("cloth_color", t::cloth_color()),
        ("cloth_normal", normals(256, t::cloth_height)),
        ("carpet_color", t::carpet_color()),
        ("leaf", t::leaf(256)),
        ("brushed_orm", t::brushed_orm()),
    ]
}
