//! Hot reload: looks at the shaders' folder now and then, and has a renderer take what changed.

use std::time::{Duration, Instant};

use cairn_shaders::reload::{Watch, replace};

use crate::frame::Renderer;

/// Time between two looks.
const INTERVAL: Duration = Duration::from_secs(1);

/// The watch of a running player.
#[derive(Debug)]
pub struct HotReload {
    watch: Result<Watch, String>,
    looked: Instant,
    /// What was said last, so that it is said once.
    said: Option<String>,
}

impl HotReload {
    /// Watches `CAIRN_SHADERS`, or else the folder that the player was built from.
    pub fn new() -> Self {
        Self {
            watch: Watch::from_environment(),
            looked: Instant::now(),
            said: None,
        }
    }

    /// Once a second, has `renderer` take the shaders that changed. True where it did.
    ///
    /// # Errors
    /// What is wrong with the shaders, once; the renderer stays as it was.
    pub fn look(&mut self, renderer: &mut Renderer) -> Result<bool, String> {
        if self.looked.elapsed() < INTERVAL {
            return Ok(false);
        }
        let outcome = match &mut self.watch {
            Ok(watch) => take(watch, renderer),
            Err(error) => Err(error.clone()),
        };
        self.looked = Instant::now();
        match outcome {
            Err(error) if self.said.as_ref() == Some(&error) => Ok(false),
            Err(error) => Err(self.said.insert(error).clone()),
            Ok(taken) => {
                // The same mistake may be made again.
                self.said = self.said.take().filter(|_| !taken);
                Ok(taken)
            }
        }
    }
}

impl Default for HotReload {
    fn default() -> Self {
        Self::new()
    }
}

/// Compiles what changed and rebuilds the renderer's pipelines; false where nothing changed.
///
/// # Errors
/// The compiler's messages, as `file:line: message`, or the driver's; the renderer stays as it was.
pub fn take(watch: &mut Watch, renderer: &mut Renderer) -> Result<bool, String> {
    let Some(changed) = watch.poll()? else {
        return Ok(false);
    };
    let before = replace(changed);
    if let Err(error) = renderer.rebuild_pipelines() {
        replace(before);
        return Err(error.to_string());
    }
    Ok(true)
}
