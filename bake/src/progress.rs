//! Progress of a bake: what a caller may listen to, and the bars of the command line.

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};

/// Hears how far each stage is.
pub trait Progress: Sync {
    /// `fraction` runs from 0 to 1 within a stage; stages follow each other, the last call of each gives 1.
    fn update(&self, stage: &str, fraction: f32);
}

/// Listens to nothing.
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _stage: &str, _fraction: f32) {}
}

/// One bar on standard error that names the running stage.
pub struct Bar {
    bar: ProgressBar,
    stage: Mutex<String>,
}

/// Resolution of the bar.
const STEPS: u64 = 1000;

impl Bar {
    /// A bar; invisible where standard error is no terminal.
    pub fn new() -> Self {
        let bar = ProgressBar::new(STEPS);
        let style = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3}% {elapsed}");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        Self {
            bar,
            stage: Mutex::default(),
        }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

impl Default for Bar {
    fn default() -> Self {
        Self::new()
    }
}

impl Progress for Bar {
    fn update(&self, stage: &str, fraction: f32) {
        let mut current = self
            .stage
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        if *current != stage {
            stage.clone_into(&mut current);
            self.bar.set_message(stage.to_owned());
            self.bar.reset_elapsed();
        }
        self.bar
            .set_position((fraction.clamp(0.0, 1.0) * STEPS as f32) as u64);
    }
}
