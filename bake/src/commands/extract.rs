//! Writes a texture, a cube or a mesh of a package back out.

use std::path::{Path, PathBuf};

use cairn_format::Package;
use cairn_format::scene::ArchivedImage;

use super::{SUCCESS, print_json};
use crate::diagnostic::{BakeError, Result};
use crate::look::{self, export, origin, printable, refused};
use crate::write;

/// `cairn-bake extract PACKAGE --texture NAME -o FILE`.
#[derive(clap::Args, Debug)]
#[command(after_help = EXAMPLES)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["texture", "mesh"])))]
pub struct Extract {
    /// The package.
    path: PathBuf,
    /// An image, by its name, or by its place as #3: .png, .exr, .dds or .ktx2. Cubes of the environment are sky,
    /// irradiance and prefiltered; they are no .png.
    #[arg(long, value_name = "NAME")]
    texture: Option<String>,
    /// A mesh, by its name, or by its place as #3: .ply.
    #[arg(long, value_name = "NAME")]
    mesh: Option<String>,
    /// Level of a .png or .exr, 0 the largest; .dds and .ktx2 hold all.
    #[arg(long, default_value_t = 0, conflicts_with = "mesh")]
    level: usize,
    /// The file to write; its extension says how.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Print what was written as one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  cairn-bake extract hall.cairn --texture stone -o stone.png
  cairn-bake extract hall.cairn --texture sky -o sky.exr
  cairn-bake extract hall.cairn --texture '#0' -o first.ktx2
  cairn-bake extract hall.cairn --mesh pillar -o pillar.ply

The faces of a cube stand one under the other in an .exr: +X -X +Y -Y +Z -Z.";

impl Extract {
    pub(super) fn run(&self) -> Result<u8> {
        let package = look::open(&self.path)?;
        let same = |path: &Path| path.canonicalize().ok();
        if same(&self.output).is_some_and(|output| Some(output) == same(&self.path)) {
            return Err(self.error("output-is-input", "the output would overwrite the package"));
        }
        let bytes = match (&self.texture, &self.mesh) {
            (Some(name), _) => self.texture(&package, name)?,
            (None, Some(name)) => self.mesh(&package, name)?,
            (None, None) => unreachable!("the parser asks for one of them"),
        };
        write::bytes(&self.output, &bytes)?;
        if self.json {
            let output = self.output.display().to_string();
            print_json(&serde_json::json!({"output": output, "bytes": bytes.len()}))?;
        }
        Ok(SUCCESS)
    }

    fn texture(&self, package: &Package, name: &str) -> Result<Vec<u8>> {
        let images = &package.scene().images;
        let index = self.find(
            name,
            "image",
            images.iter().map(|image| image.name.as_str()),
        )?;
        let image: &ArchivedImage = &images[index];
        if self.level >= image.levels.len() {
            let what = format!(
                "level {} of {}: the largest is 0",
                self.level,
                image.levels.len()
            );
            return Err(self.error("no-such-object", &what));
        }
        let texels = package
            .texels()
            .map_err(|error| refused(&self.path, error))?;
        let encoded = match self.extension().as_str() {
            "png" => export::png(image, texels, self.level),
            "exr" => export::exr(image, texels, self.level),
            "dds" => export::dds(image, texels),
            "ktx2" => Ok(export::ktx2(image, texels)),
            other => Err(format!(
                "`.{other}`: an image becomes .png, .exr, .dds or .ktx2"
            )),
        };
        encoded.map_err(|what| self.error("output-format", &what))
    }

    fn mesh(&self, package: &Package, name: &str) -> Result<Vec<u8>> {
        let scene = package.scene();
        let index = self.find(
            name,
            "mesh",
            scene.meshes.iter().map(|mesh| mesh.name.as_str()),
        )?;
        if self.extension() != "ply" {
            let what = format!("`.{}`: a mesh becomes .ply", self.extension());
            return Err(self.error("output-format", &what));
        }
        let mesh = look::mesh(package, index).map_err(|error| refused(&self.path, error))?;
        let materials: Vec<&str> = scene
            .materials
            .iter()
            .map(|row| row.name.as_str())
            .collect();
        Ok(export::ply(&mesh, &materials))
    }

    fn extension(&self) -> String {
        let extension = self.output.extension().unwrap_or_default();
        extension.to_string_lossy().to_lowercase()
    }

    /// Index of the object of a name, or of `#` and its place.
    fn find<'a>(
        &self,
        wanted: &str,
        kind: &str,
        names: impl Iterator<Item = &'a str>,
    ) -> Result<usize> {
        let names: Vec<&str> = names.collect();
        let matches: Vec<usize> = (0..names.len())
            .filter(|index| names[*index] == wanted)
            .collect();
        if let [index] = matches.as_slice() {
            return Ok(*index);
        }
        if matches.len() > 1 {
            let places: Vec<String> = matches.iter().map(|index| format!("#{index}")).collect();
            let what = format!(
                "{} of the name `{}`: say which by its place, {}",
                kind,
                printable(wanted),
                places.join(" or ")
            );
            return Err(self.error("no-such-object", &what));
        }
        let place = wanted
            .strip_prefix('#')
            .and_then(|place| place.parse().ok());
        place.filter(|place| *place < names.len()).ok_or_else(|| {
            let known: Vec<String> = names.iter().take(20).map(|name| printable(name)).collect();
            let what = format!(
                "no {kind} `{}` of {}: {}{}",
                printable(wanted),
                names.len(),
                known.join(", "),
                if names.len() > 20 { ", ..." } else { "" }
            );
            self.error("no-such-object", &what)
        })
    }

    fn error(&self, code: &'static str, what: &str) -> BakeError {
        BakeError::input(code, &origin(&self.path), what)
    }
}
