//! The panel of the window, made from the table of settings: settings, statistics, bookmarks, the last error.

use egui::{ComboBox, DragValue, Slider, Ui as Region};
use winit::event::WindowEvent;
use winit::window::Window;

use super::state::State;
use crate::camera::Camera;
use crate::draw::DrawStats;
use crate::gpu::{Commands, Gpu, GpuResult, ImageRef, Layouts, PassTime, vk};
use crate::passes::ui::Ui;
use crate::settings::Settings;
use crate::settings::table::{Field, Group, Kind, Value};

/// What the panel shows of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Statistics<'a> {
    pub draws: DrawStats,
    /// Instances of the package.
    pub instances: u64,
    pub passes: &'a [PassTime],
    /// Bytes uploaded.
    pub uploaded: u64,
    /// Seconds between frames.
    pub seconds: f32,
}

/// The panel and its memory.
pub struct Panel {
    painter: Ui,
    input: egui_winit::State,
    /// Shown; F1 toggles.
    pub visible: bool,
    /// What went wrong last.
    pub error: Option<String>,
    bookmark: String,
}

impl Panel {
    /// A panel that draws into sRGB targets of `format`.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        format: vk::Format,
        window: &Window,
    ) -> GpuResult<Self> {
        let context = egui::Context::default();
        let side = gpu.limits().max_image_dimension2_d as usize;
        let scale = window.scale_factor() as f32;
        let viewport = egui::ViewportId::ROOT;
        Ok(Self {
            painter: Ui::new(gpu, layouts, format)?,
            input: egui_winit::State::new(context, viewport, window, Some(scale), None, Some(side)),
            visible: true,
            error: None,
            bookmark: "view".into(),
        })
    }

    /// Compiles the pipeline anew; where that fails, it stays as it is.
    ///
    /// # Errors
    /// Failures of Vulkan.
    #[cfg(feature = "hot-reload")]
    pub fn rebuild_pipeline(&mut self, format: vk::Format) -> GpuResult<()> {
        self.painter.rebuild_pipeline(format)
    }

    /// Passes an event on; true where the panel used it.
    pub fn event(&mut self, window: &Window, event: &WindowEvent) -> bool {
        self.visible && self.input.on_window_event(window, event).consumed
    }

    /// Lays the panel out for the frame of `slot`; what is changed in it changes `state`. Returns the bookmark to
    /// go to.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn update(
        &mut self,
        slot: usize,
        window: &Window,
        extent: [u32; 2],
        state: &mut State,
        camera: &Camera,
        statistics: &Statistics<'_>,
    ) -> GpuResult<Option<Camera>> {
        if !self.visible {
            return Ok(None);
        }
        let context = self.input.egui_ctx().clone();
        let input = self.input.take_egui_input(window);
        let mut go = None;
        let (error, bookmark) = (&mut self.error, &mut self.bookmark);
        let output = context.run_ui(input, |root| {
            egui::Panel::left("cairn").show(root, |ui| {
                egui::ScrollArea::vertical().show(ui, |ui| {
                    banner(ui, error);
                    show_statistics(ui, statistics);
                    go = bookmarks(ui, bookmark, &mut state.cameras, camera);
                    settings(ui, &mut state.settings);
                });
            });
        });
        self.input
            .handle_platform_output(window, output.platform_output);
        let primitives = context.tessellate(output.shapes, output.pixels_per_point);
        let scale = output.pixels_per_point;
        self.painter
            .update(slot, output.textures_delta, &primitives, extent, scale)?;
        Ok(go)
    }

    /// Draws it over `target`.
    pub fn record(&self, commands: &mut Commands, target: ImageRef<'_>) {
        if self.visible {
            self.painter.record(commands, target);
        }
    }
}

fn banner(ui: &mut Region, error: &mut Option<String>) {
    let Some(text) = error.clone() else { return };
    ui.colored_label(egui::Color32::LIGHT_RED, text);
    if ui.button("Dismiss").clicked() {
        *error = None;
    }
}

fn show_statistics(ui: &mut Region, statistics: &Statistics<'_>) {
    let draws = &statistics.draws;
    let visible = u64::from(draws.visible_instances);
    ui.label("F1 hides this. Right-drag looks, WASD flies.");
    ui.monospace(format!(
        "{:>9.2} ms between frames",
        statistics.seconds * 1e3
    ));
    ui.monospace(format!(
        "{visible:>9} visible, {} culled",
        statistics.instances.saturating_sub(visible)
    ));
    ui.monospace(format!("{:>9} draws", draws.draws));
    ui.monospace(format!("{:>9} triangles", draws.triangles));
    ui.monospace(format!(
        "{:>9.1} MB uploaded",
        statistics.uploaded as f64 / 1e6
    ));
    ui.collapsing("Passes", |ui| {
        for pass in statistics.passes {
            ui.monospace(format!(
                "{:>9.3} ms {}",
                pass.milliseconds,
                pass.name.to_string_lossy()
            ));
        }
    });
}

fn bookmarks(
    ui: &mut Region,
    name: &mut String,
    cameras: &mut Vec<(String, Camera)>,
    camera: &Camera,
) -> Option<Camera> {
    let mut go = None;
    ui.collapsing("Bookmarks", |ui| {
        ui.horizontal(|ui| {
            ui.add(egui::TextEdit::singleline(name).desired_width(90.0));
            if ui.button("Save").clicked() && !name.trim().is_empty() {
                cameras.retain(|(known, _)| known != name);
                cameras.push((name.clone(), *camera));
                cameras.sort_by(|a, b| a.0.cmp(&b.0));
            }
        });
        let mut removed = None;
        for (index, (name, camera)) in cameras.iter().enumerate() {
            ui.horizontal(|ui| {
                if ui.button(name).clicked() {
                    go = Some(*camera);
                }
                if ui.small_button("remove").clicked() {
                    removed = Some(index);
                }
            });
        }
        if let Some(index) = removed {
            cameras.remove(index);
        }
    });
    go
}

fn settings(ui: &mut Region, settings: &mut Settings) {
    if ui.button("Defaults").clicked() {
        *settings = Settings::default();
    }
    for (group, name) in Settings::group_names().enumerate() {
        let members = settings.group_mut(group);
        if name.is_empty() {
            fields(ui, name, members);
        } else {
            ui.collapsing(name, |ui| fields(ui, name, members));
        }
    }
}

fn fields(ui: &mut Region, group: &str, members: &mut dyn Group) {
    for (index, field) in members.fields().iter().enumerate() {
        let value = members.get(index);
        let changed = widget(ui, group, field, value);
        if changed != value {
            members.set(index, changed);
        }
    }
}

/// Shows a value and returns what it was changed to.
fn widget(ui: &mut Region, group: &str, field: &Field, value: Value) -> Value {
    let label = field.name.replace('_', " ");
    let doc = field.doc.trim();
    match (value, field.kind) {
        (Value::Switch(mut on), _) => {
            ui.checkbox(&mut on, label).on_hover_text(doc);
            Value::Switch(on)
        }
        (Value::Integer(mut number), Kind::Integer(least, most)) => {
            ui.add(Slider::new(&mut number, least..=most).text(label))
                .on_hover_text(doc);
            Value::Integer(number)
        }
        (Value::Integer(mut number), Kind::OneOf(values)) => {
            let names = values.iter().map(|value| (*value, value.to_string()));
            choose(ui, group, &label, doc, &mut number, names);
            Value::Integer(number)
        }
        (Value::Number(mut number), Kind::Degrees(least, most)) => {
            let mut degrees = number.to_degrees();
            if ui
                .add(
                    Slider::new(&mut degrees, least..=most)
                        .suffix("\u{b0}")
                        .text(label),
                )
                .on_hover_text(doc)
                .changed()
            {
                number = degrees
                    .to_radians()
                    .clamp(least.to_radians(), most.to_radians());
            }
            Value::Number(number)
        }
        // Unbounded for practice: a slider would have no use of its length.
        (Value::Number(mut number), Kind::Number(least, most)) if most - least > 200.0 => {
            ui.horizontal(|ui| {
                ui.add(DragValue::new(&mut number).range(least..=most).speed(0.02));
                ui.label(label).on_hover_text(doc);
            });
            Value::Number(number)
        }
        (Value::Number(mut number), Kind::Number(least, most)) => {
            ui.add(Slider::new(&mut number, least..=most).text(label))
                .on_hover_text(doc);
            Value::Number(number)
        }
        (Value::Choice(mut name), Kind::Choice(choices)) => {
            let names = choices
                .iter()
                .map(|choice| (choice.name, choice.name.to_owned()));
            choose(ui, group, &label, doc, &mut name, names);
            Value::Choice(name)
        }
        (other, _) => other,
    }
}

fn choose<T: PartialEq + Copy + ToString>(
    ui: &mut Region,
    group: &str,
    label: &str,
    doc: &str,
    value: &mut T,
    names: impl Iterator<Item = (T, String)>,
) {
    let shown = value.to_string();
    let list = ComboBox::new((group, label), label).selected_text(shown);
    let response = list.show_ui(ui, |ui| {
        for (choice, name) in names {
            ui.selectable_value(value, choice, name);
        }
    });
    response.response.on_hover_text(doc);
}
