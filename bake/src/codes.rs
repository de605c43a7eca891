//! Every code a message can have: why it matters, and what to do. `docs/diagnostics.md` is made from this table.

/// What stands behind a code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// Stable name, as messages, `--strict` and JSON give it.
    pub name: &'static str,
    pub level: Level,
    /// What goes wrong otherwise.
    pub why: &'static str,
    /// What to do.
    pub fix: &'static str,
}

/// Whether a code stops the bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// It does: nothing is written.
    Error,
    /// It does not, unless `--strict` names it.
    Warning,
    /// Both: where nothing sensible can be read in its place, it stops the bake.
    Either,
}

impl Level {
    /// As the documentation has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
            Self::Either => "warning or error",
        }
    }
}

/// The entry of a code.
pub fn find(name: &str) -> Option<&'static Code> {
    CODES
        .binary_search_by(|code| code.name.cmp(name))
        .ok()
        .map(|index| &CODES[index])
}

/// The reference of all codes, as Markdown.
pub fn markdown() -> String {
    let mut text = String::from(
        "# Diagnostics\n\n\
         Every message of `cairn-bake` has the form `severity[code]: file at place (object): what`, and under it why\n\
         it matters and what to do. The place is a JSON pointer into the glTF file, or a byte. A warning becomes an\n\
         error with `--strict CODE`, every warning with `--strict`. Errors exit with 2 and write nothing.\n\n\
         This page is made from the table in `bake/src/codes.rs`.\n",
    );
    for code in CODES {
        text += &format!(
            "\n## {}\n\n*{}.* {}\n\n**Remedy:** {}\n",
            code.name,
            code.level.name(),
            code.why,
            code.fix
        );
    }
    text
}

/// Remedy of files that contradict themselves.
const EXPORT: &str = "Export the file again; if the exporter did this, report it to its authors.";

macro_rules! codes {
    ($($level:ident $name:literal: $why:literal => $fix:expr;)*) => {
        /// Sorted by name.
        pub const CODES: &[Code] = &[$(Code {
            name: $name,
            level: Level::$level,
            why: $why,
            fix: $fix,
        }),*];
    };
}

codes! {
    Error "accessor-out-of-range": "The accessor would read beyond its buffer view."
        => EXPORT;
    Error "accessor-sparse": "The sparse part of an accessor replaces elements that do not exist, or in no order."
        => EXPORT;
    Error "accessor-type": "The data has another type than its use asks for, so its bytes would be read as something else."
        => EXPORT;
    Warning "animation-ignored": "A package is static: nothing moves in the player."
        => "Nothing, if the default pose is what you want; else pose the scene before the export.";
    Error "attribute-count": "Attributes of one primitive must have a value for each vertex."
        => EXPORT;
    Error "buffer-too-short": "The file that holds the data ends before the data does: it was cut."
        => "Copy or download the file again, or export again.";
    Error "buffer-view-out-of-range": "The buffer view would read beyond its buffer."
        => EXPORT;
    Error "buffer-view-stride": "Elements would overlap or miss their alignment."
        => EXPORT;
    Error "buffer-without-data": "The buffer names no file, and the file has no binary chunk."
        => "Export as .glb, or with a .bin file beside the .gltf.";
    Error "cache-off": "A command about the cache was given `--cache off`."
        => "Name the folder of the cache, or leave the flag away.";
    Warning "camera-invalid": "The camera's numbers span no view, so it is left out."
        => "Correct the field of view and the planes in the scene's editor.";
    Error "camera-type": "The camera is neither perspective nor orthographic."
        => EXPORT;
    Warning "degenerate-triangles": "Triangles without area cover no pixel; they are left out."
        => "Nothing; or clean the mesh in its editor.";
    Error "draco": "The compressed mesh cannot be decoded."
        => "Export without Draco, or with another version of it.";
    Error "draco-attribute": "The compressed mesh lacks an attribute that the primitive names."
        => EXPORT;
    Error "draco-count": "The compressed mesh has another number of elements than the accessor says."
        => EXPORT;
    Warning "emissive-triangles": "The path tracer's table of light-emitting triangles has a limit; what is beyond it is found by chance alone, with more noise."
        => "Emit from fewer triangles.";
    Warning "environment-aspect": "A panorama of the whole sphere is twice as wide as it is high; others are stretched."
        => "Use an equirectangular panorama of 2:1.";
    Error "environment-broken": "The panorama cannot be decoded: it is cut, or damaged."
        => "Copy or download the file again.";
    Error "environment-format": "The file is no panorama that the bake reads."
        => "Convert it to Radiance .hdr or OpenEXR.";
    Warning "environment-header": "The panorama's header has an entry that changes nothing, or that cannot be read."
        => "Nothing, if the picture looks right.";
    Warning "environment-layers": "An OpenEXR file has several layers; the first with colour is taken."
        => "Store the sky alone in the file.";
    Warning "environment-values": "Texels that are no numbers, or negative, are replaced: they would spread over all light."
        => "Clean the panorama in an image editor.";
    Warning "environment-window": "The picture covers a part of its display window; the rest is black."
        => "Crop the display window to the picture.";
    Warning "extension-ignored": "The scene uses a glTF extension that the bake does not read; what it says is missing in the package."
        => "Nothing, if the picture looks right without; else export without the extension.";
    Error "extension-required": "The scene cannot be shown right without a glTF extension that the bake does not read."
        => "Export without the extension.";
    Error "extension-schema": "The data of a glTF extension does not have the form that its specification gives."
        => EXPORT;
    Error "file-missing": "A file that the scene names cannot be read."
        => "Put the file where the message says, or correct the URI in the scene.";
    Either "glb": "The binary container contradicts itself."
        => EXPORT;
    Error "gltf-schema": "A property has a value that the glTF schema does not allow."
        => EXPORT;
    Error "gltf-version": "Only glTF 2.0 is read."
        => "Convert or export the scene as glTF 2.0.";
    Error "image-broken": "The image cannot be decoded: it is cut, damaged or of a kind that its format forbids."
        => "Open and save the image in an editor, or copy it again.";
    Error "image-format": "The bytes are no image that the bake reads, or not what their MIME type says."
        => "Convert the image to PNG, JPEG, WebP, KTX2 or DDS.";
    Error "image-size": "The image would take more memory than `--limit-pixels` allows."
        => "Scale the image down, or raise the limit.";
    Error "image-source": "The image or texture has no source, or two."
        => EXPORT;
    Error "index-count": "The number of indices makes no whole triangles."
        => EXPORT;
    Error "index-out-of-range": "A reference points to an element that does not exist."
        => EXPORT;
    Error "index-restart": "The index that restarts primitives is not allowed in glTF."
        => EXPORT;
    Warning "instancing-empty": "The node places a mesh no times at all, so it is not seen."
        => "Nothing, if that is meant.";
    Error "invalid-node": "An instance names a mesh, camera or light that does not exist."
        => "Give the library's scene valid indices; from a glTF file this is a bug of the bake.";
    Error "invalid-primitive": "A primitive contradicts itself: an index beyond its vertices, or attributes of other lengths."
        => "Give the library's scene consistent arrays; from a glTF file this is a bug of the bake.";
    Error "io": "The operating system refused to read or write a file."
        => "See the system's message: rights, space, or a folder that does not exist.";
    Error "json": "A file that should be a summary of a bake is none."
        => "Write it with cairn-bake --json.";
    Error "json-syntax": "The text is no JSON."
        => "Correct the place that the message names, or export again.";
    Warning "light-cone": "The cone of a spot light is not one that light can have; it is corrected."
        => "Correct the angles in the scene's editor.";
    Warning "light-direction": "The light's node has no direction, because its scale is zero."
        => "Give the node a scale.";
    Warning "light-range": "The range of a light must be positive; it is taken as infinite."
        => "Correct the range in the scene's editor.";
    Error "light-type": "The light is neither directional, point nor spot."
        => EXPORT;
    Warning "light-value": "The light's colour or intensity is negative or no number; it is left out or corrected."
        => "Correct the light in the scene's editor.";
    Error "limit-memory": "The input takes more memory than `--limit-memory` allows."
        => "Raise the limit, or make the input smaller.";
    Error "material-alpha-mode": "The alpha mode is none of OPAQUE, MASK and BLEND."
        => EXPORT;
    Warning "material-value": "A material's number lies outside its range and is clamped."
        => "Correct the material in the scene's editor.";
    Error "meshopt": "The compressed data cannot be decoded."
        => "Export without meshopt compression, or with another version of it.";
    Warning "morph-target-static": "Morph targets are applied once, with the default weights."
        => "Nothing, if the default shape is what you want.";
    Error "morph-weight": "A morph target's weight is no number."
        => EXPORT;
    Error "no-such-object": "The package has no such texture, mesh or cube."
        => "List its content with cairn-bake inspect.";
    Error "node-cycle": "A node is its own ancestor, so it has no place in the world."
        => EXPORT;
    Warning "node-matrix-projective": "The last row of a node's matrix is not 0 0 0 1; it is taken as if it were."
        => EXPORT;
    Error "node-shared": "A node has two parents, so it has no one place in the world."
        => EXPORT;
    Warning "node-transform": "A node has a matrix and a translation, rotation or scale beside it; the matrix counts."
        => EXPORT;
    Error "non-finite-attribute": "A vertex attribute is no finite number."
        => EXPORT;
    Error "non-finite-camera": "A camera's place or numbers are not finite."
        => EXPORT;
    Error "non-finite-light": "A light's place or direction is not finite."
        => EXPORT;
    Error "non-finite-position": "A position is no finite number, so the triangle has no place."
        => EXPORT;
    Error "non-finite-transform": "A transform is not finite, so what it moves has no place."
        => EXPORT;
    Error "not-gltf": "The file is something else than glTF."
        => "Export the scene as glTF 2.0: .gltf or .glb.";
    Error "number-range": "A number is too large for 32 bits, the precision that glTF has."
        => EXPORT;
    Error "output-format": "The output's extension is none that this kind of object is written as."
        => "Use an extension that the message names.";
    Error "output-is-input": "The output would overwrite an input."
        => "Choose another -o.";
    Error "package": "The finished package broke a rule of its own format: a bug of the bake."
        => "Report it with the scene; nothing was written.";
    Warning "primitive-empty": "A primitive has no triangle, so it is left out."
        => "Nothing; or clean the mesh in its editor.";
    Error "primitive-mode": "The topology is none that glTF has."
        => EXPORT;
    Warning "primitive-without-position": "A primitive without positions cannot be seen; it is left out."
        => EXPORT;
    Warning "quaternion-not-unit": "A rotation is not of unit length; it is normalised."
        => EXPORT;
    Warning "quaternion-zero": "A rotation of zero length turns nothing; it is taken as none."
        => EXPORT;
    Error "sampler-value": "A sampler's filter or wrap mode is none that glTF has."
        => EXPORT;
    Error "scene-too-large": "The scene decodes to more than any package can hold; a small file can name its data any number of times."
        => "Split the scene.";
    Warning "skin-attributes": "A skinned mesh lacks joints or weights, so its skin is not applied."
        => EXPORT;
    Error "skin-joint": "A joint number of a skinned vertex names no joint of its skin."
        => EXPORT;
    Error "skin-matrices": "A skin has another number of inverse bind matrices than of joints."
        => EXPORT;
    Warning "skin-static": "Skins are applied once, in the default pose."
        => "Nothing, if the default pose is what you want; else pose the scene before the export.";
    Error "sky-format": "The sky cannot be stored as asked for."
        => "Choose another --sky-format.";
    Warning "tangents-arbitrary": "A normal map lies on triangles without texture coordinates to derive tangents from; its bumps point in arbitrary directions."
        => "Export with tangents, or unwrap the mesh.";
    Warning "texcoord-set": "The material reads a set of texture coordinates that the package does not hold."
        => "Use the first two sets.";
    Warning "texture-quality-missed": "A texture cannot reach the quality that was asked for in any preset."
        => "Ask for less, or store the image without compression.";
    Warning "texture-transform": "The transform of a texture is not finite or belongs to a slot that has none; it is left out."
        => EXPORT;
    Warning "texture-without-source": "A texture without an image shows white."
        => "Export again with the image; or name an extension that holds it.";
    Warning "toksvig-unpaired": "With --toksvig normals widen roughness texel by texel; here the two are read at other coordinates, and the roughness stays as it is."
        => "Give the normal and the metallic-roughness texture of the material the same coordinates.";
    Error "too-large": "Counts or offsets do not fit the 32 bits that the GPU reads."
        => "Split the scene.";
    Error "uri-absolute": "A scene must not name files by absolute paths: it would read any file of this machine."
        => "Put the file beside the scene; or trust the scene with --allow-external.";
    Error "uri-data": "A data URI cannot be decoded."
        => EXPORT;
    Error "uri-empty": "A URI names no file."
        => EXPORT;
    Error "uri-encoding": "A URI is not valid percent-encoded UTF-8."
        => EXPORT;
    Error "uri-outside": "A scene must not name files outside its folder: it would read any file of this machine."
        => "Put the file beside the scene; or trust the scene with --allow-external.";
    Error "uri-scheme": "The bake reads files, and nothing from the network."
        => "Download the file and name it relative to the scene.";
    Error "verify-settings": "Settings of a bake mean nothing where no scene is baked."
        => "Add --twice, or leave the settings away.";
    Warning "vertex-color-ignored": "Vertex colours of this form are not read."
        => "Use COLOR_0 as RGB or RGBA.";
    Warning "vertex-color-range": "Vertex colours outside 0 to 1 are clamped."
        => EXPORT;
    Error "world-overflow": "Positions in the world are too large for 32-bit floats."
        => "Scale the scene down.";
}

#[cfg(test)]
#[path = "codes_tests.rs"]
mod tests;
