//! Scenes by name or path: the one place that reads scene files.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_128;

use super::{MeshFile, PRESETS, Preset, Sample, Scene, SceneError, Shape};

/// Longer than any scene; what is longer isn't one.
const LONGEST: u64 = 1 << 20;

/// The scene of a preset's name or a file's path; presets come first.
///
/// # Errors
/// [`SceneError::File`] if there is no such preset or file, [`SceneError`] if it is wrong.
pub fn load(name_or_path: &str) -> Result<Scene, SceneError> {
    let (text, origin) = text(name_or_path)?;
    from_text(&text, &origin)
}

/// The scene of a text; a mesh is looked for from the folder of its file, so that the scene can be moved with it.
///
/// # Errors
/// [`SceneError`] if it is wrong.
pub fn from_text(text: &str, origin: &str) -> Result<Scene, SceneError> {
    let mut scene = Scene::from_toml(text, origin)?;
    if let Shape::Mesh(mesh) | Shape::Outline(mesh) = &mut scene.sample.shape {
        let path = Path::new(origin).with_file_name("").join(&mesh.path);
        mesh.path = std::path::absolute(&path).unwrap_or(path).to_string_lossy().into_owned();
    }
    Ok(scene)
}

impl Sample {
    /// Digest of the mesh file's content, which no key says; empty without one. One that can't be read has a digest of that.
    #[must_use]
    pub fn mesh_digest(&self) -> String {
        let content = |mesh: &MeshFile| fs::read(&mesh.path).unwrap_or_else(|error| error.to_string().into_bytes());
        self.shape.mesh().map_or_else(String::new, |mesh| format!("{:032x}", xxh3_128(&content(mesh))))
    }
}

/// Text of a scene and what messages call it.
///
/// # Errors
/// As [`load`], but the text isn't looked at.
pub fn text(name_or_path: &str) -> Result<(String, String), SceneError> {
    match Preset::find(name_or_path) {
        Ok(preset) => Ok((preset.text.to_owned(), preset.name.to_owned())),
        Err(unknown) => Ok((read(Path::new(name_or_path), &unknown)?, name_or_path.to_owned())),
    }
}

fn read(path: &Path, unknown: &SceneError) -> Result<String, SceneError> {
    let refuse = |reason: String| SceneError::File { path: path.to_owned(), reason };
    if !path.exists() {
        return Err(refuse(format!("no such scene file, and {unknown}")));
    }
    if path.is_dir() {
        return Err(refuse("a folder, not a scene file".to_owned()));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| refuse(format!("can't be read: {error}")))?;
    file.take(LONGEST + 1).read_to_end(&mut bytes).map_err(|error| refuse(format!("can't be read: {error}")))?;
    if bytes.len() as u64 > LONGEST {
        return Err(refuse(format!("not a scene file: longer than {LONGEST} bytes")));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        refuse(format!("not TOML: byte {at} is not UTF-8 text; see `needle_twin scene show {}`", PRESETS[0].name))
    })
}
