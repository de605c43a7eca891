//! Reads a package as another engine would: by `cairn-format` alone, without our player.
//!
//! `cargo run -p cairn-format --example read -- scene.cairn`

use std::path::Path;
use std::process::ExitCode;

use cairn_format::gpu::{NO_TEXTURE, TEXTURE_UV1};
use cairn_format::{Package, Result, SectionKind};

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: read PACKAGE");
        return ExitCode::from(2);
    };
    match list_draws(Path::new(&path)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// Prints what an engine would upload and draw.
fn list_draws(path: &Path) -> Result<()> {
    // Header, section table and root are checked here; bulk data is only mapped.
    let package = Package::open(path)?;
    // An engine may check bulk data while it copies it, by the functions of `cairn_format::check`, or all at once.
    package.verify()?;

    // Sections are arrays of plain records, ready to be copied to the GPU as they are.
    for (name, kind) in [
        ("vertices", SectionKind::Vertices),
        ("indices", SectionKind::Indices),
    ] {
        let bytes = package.section(kind)?;
        println!("upload {name}: {} bytes", bytes.len());
    }
    let (scene, texels) = (package.scene(), package.texels()?);
    for image in scene.images.iter() {
        let format = image.format.native();
        for (level, stored) in image.levels.iter().enumerate() {
            let start = stored.offset.to_native() as usize;
            let blocks = &texels[start..start + stored.length.to_native() as usize];
            println!(
                "upload {} level {level}: {} bytes of {format:?}",
                image.name,
                blocks.len()
            );
        }
    }

    // One indexed draw a group; its instances follow each other.
    let (instances, materials) = (package.instances()?, package.materials()?);
    for group in package.draw_groups()? {
        let first = group.first_instance as usize;
        let drawn = &instances[first..first + group.instance_count as usize];
        let Some(material) = drawn
            .first()
            .map(|instance| &materials[instance.material_index as usize])
        else {
            continue;
        };
        let texture = match material.base_color_tex {
            NO_TEXTURE => "no texture".to_owned(),
            reference => {
                let slot = &scene.textures[(reference & !TEXTURE_UV1) as usize];
                scene.images[slot.image.to_native() as usize]
                    .name
                    .to_string()
            }
        };
        println!(
            "draw {} triangles from index {}, vertex offset {}, {} instances, base colour {:?}, {texture}",
            group.index_count / 3,
            group.first_index,
            group.vertex_offset,
            group.instance_count,
            material.base_color_factor
        );
    }
    Ok(())
}
