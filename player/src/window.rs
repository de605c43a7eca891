//! Shows a package in a window that one flies through.

mod fly;
#[cfg(feature = "ui")]
mod panel;
pub mod state;

use std::sync::Arc;
use std::time::Instant;

use cairn_format::Package;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{DeviceEvent, DeviceId, ElementState, MouseButton, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{CursorGrabMode, Window, WindowId};

use crate::PlayerError;
use crate::camera::Camera;
use crate::frame::Renderer;
use crate::gpu::swapchain::{Acquired, Swapchain};
use crate::gpu::{FrameTarget, Frames, Gpu, GpuError, GpuOptions, Sync, vk};
use crate::scene::{GpuScene, bounds};
use crate::settings::Settings;
use fly::Fly;
#[cfg(feature = "ui")]
use panel::{Panel, Statistics};
use state::State;

/// What to show.
#[derive(Clone, Debug)]
pub struct WindowOptions {
    /// Pixels at the beginning.
    pub size: [u32; 2],
    /// Viewpoint at the beginning.
    pub camera: Camera,
    /// Look of every frame.
    pub settings: Settings,
    /// Close after this many frames.
    pub frames: Option<u32>,
    /// Device and validation.
    pub gpu: GpuOptions,
    /// Bookmarks.
    pub cameras: Vec<(String, Camera)>,
    /// Where settings and bookmarks that were changed are kept; nowhere where absent.
    pub state: Option<std::path::PathBuf>,
    /// Whether the panel is shown at the beginning.
    pub panel: bool,
}

/// Shows `package` until the window is closed, Escape is pressed, or `options.frames` frames were shown. Returns the
/// messages of the validation layer. Right mouse button and movement looks; W A S D, Space and C or Ctrl fly,
/// faster with Shift; F shows the whole scene.
///
/// # Errors
/// `Gpu` where there is no display, or Vulkan fails; `Package` where the package is damaged.
pub fn run(package: &Package, options: &WindowOptions) -> Result<Vec<String>, PlayerError> {
    let event_loop = EventLoop::new().map_err(|error| no_window(&error))?;
    event_loop.set_control_flow(ControlFlow::Wait);
    let mut application = Application::new(package, options);
    let ran = event_loop.run_app(&mut application);
    ran.map_err(|error| no_window(&error))?;
    application.outcome
}

fn no_window(error: &dyn std::fmt::Display) -> PlayerError {
    let names_a_display = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let unix = cfg!(all(unix, not(target_os = "macos")));
    let cause = if unix
        && !["DISPLAY", "WAYLAND_DISPLAY"]
            .into_iter()
            .any(names_a_display)
    {
        "neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned()
    } else {
        error.to_string()
    };
    let text = format!("{cause}; without a display, render with --headless --out FILE.png");
    GpuError::Surface(text).into()
}

/// The event handler.
struct Application<'a> {
    package: &'a Package,
    options: &'a WindowOptions,
    /// Exists while the window does.
    view: Option<View<'a>>,
    outcome: Result<Vec<String>, PlayerError>,
}

impl<'a> Application<'a> {
    fn new(package: &'a Package, options: &'a WindowOptions) -> Self {
        Self {
            package,
            options,
            view: None,
            outcome: Ok(Vec::new()),
        }
    }

    /// Ends the loop with the first error.
    fn fail(&mut self, event_loop: &ActiveEventLoop, error: PlayerError) {
        if self.outcome.is_ok() {
            self.outcome = Err(error);
        }
        event_loop.exit();
    }

    fn redraw(&mut self, event_loop: &ActiveEventLoop) {
        let Some(view) = &mut self.view else { return };
        match view.draw() {
            Ok(()) if Some(view.shown) == self.options.frames => event_loop.exit(),
            Ok(()) => {}
            Err(error) => self.fail(event_loop, error),
        }
    }
}

impl ApplicationHandler for Application<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.view.is_some() {
            return;
        }
        match View::new(event_loop, self.package, self.options) {
            Ok(view) => self.view = Some(view),
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        #[cfg(feature = "ui")]
        if let Some(view) = &mut self.view
            && view.panel.event(&view.window, &event)
        {
            return;
        }
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::RedrawRequested => self.redraw(event_loop),
            WindowEvent::KeyboardInput { event, .. } => {
                if let PhysicalKey::Code(key) = event.physical_key {
                    let pressed = event.state == ElementState::Pressed;
                    if key == KeyCode::Escape && pressed {
                        event_loop.exit();
                    } else if let Some(view) = &mut self.view {
                        view.key(key, pressed);
                    }
                }
            }
            other => {
                if let Some(view) = &mut self.view {
                    view.event(&other);
                }
            }
        }
    }

    fn device_event(&mut self, _: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let (DeviceEvent::MouseMotion { delta }, Some(view)) = (event, &mut self.view)
            && view.looking
        {
            view.fly.look([delta.0 as f32, delta.1 as f32]);
        }
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        // Presenting waits for the display; what cannot be seen is not drawn, and the loop sleeps.
        if let Some(view) = self.view.as_ref().filter(|view| view.visible()) {
            view.window.request_redraw();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // While the connection to the display is still open.
        if let (Some(view), Ok(messages)) = (self.view.take(), &mut self.outcome) {
            *messages = view.close();
        }
    }
}

/// A window and everything that draws into it. Fields are dropped in this order: users before what they use.
struct View<'a> {
    renderer: Renderer,
    #[cfg(feature = "ui")]
    panel: Panel,
    scene: GpuScene,
    frames: Frames,
    swapchain: Swapchain,
    gpu: Gpu,
    window: Arc<Window>,
    package: &'a Package,
    options: &'a WindowOptions,
    /// Settings and bookmarks now.
    state: State,
    fly: Fly,
    /// The right mouse button is held.
    looking: bool,
    occluded: bool,
    /// Pixels, by the last event: asking the system each frame would wait for it.
    size: [u32; 2],
    /// The swapchain no longer fits the window.
    outdated: bool,
    /// Frames presented.
    shown: u32,
    /// Seconds between the last two frames.
    step: f32,
    last: Instant,
    #[cfg(feature = "hot-reload")]
    reload: crate::reload::HotReload,
}

impl<'a> View<'a> {
    fn new(
        event_loop: &ActiveEventLoop,
        package: &'a Package,
        options: &'a WindowOptions,
    ) -> Result<Self, PlayerError> {
        let size = PhysicalSize::new(options.size[0], options.size[1]);
        let attributes = Window::default_attributes()
            .with_title(format!("{} - Cairn", package.scene().name))
            .with_inner_size(size);
        let window = event_loop.create_window(attributes);
        let window = Arc::new(window.map_err(|error| no_window(&error))?);
        let (gpu, surface) = Gpu::for_window(&options.gpu, window.clone())?;
        let mut swapchain = Swapchain::new(&gpu, surface)?;
        let size = window.inner_size();
        let size = [size.width, size.height];
        let shown = swapchain.recreate(size)?;
        // A window that opens minimised still needs targets of some size.
        let extent = if shown { swapchain.extent() } else { [1, 1] };
        let scene = GpuScene::upload(&gpu, package)?;
        let (format, settings) = (swapchain.format(), &options.settings);
        let renderer = Renderer::new(&gpu, &scene, package, format, extent, settings)?;
        #[cfg(feature = "ui")]
        let panel = {
            let mut panel = Panel::new(&gpu, &scene.layouts, format, &window)?;
            panel.visible = options.panel;
            panel
        };
        Ok(Self {
            renderer,
            #[cfg(feature = "ui")]
            panel,
            scene,
            frames: Frames::new(&gpu)?,
            swapchain,
            gpu,
            window,
            package,
            options,
            state: State {
                settings: settings.clone(),
                cameras: options.cameras.clone(),
            },
            fly: Fly::new(options.camera, bounds(package)),
            looking: false,
            occluded: false,
            size,
            outdated: !shown,
            shown: 0,
            step: 0.0,
            last: Instant::now(),
            #[cfg(feature = "hot-reload")]
            reload: crate::reload::HotReload::new(),
        })
    }

    fn visible(&self) -> bool {
        !self.occluded && !self.size.contains(&0)
    }

    fn key(&mut self, key: KeyCode, pressed: bool) {
        #[cfg(feature = "ui")]
        if key == KeyCode::F1 && pressed {
            self.panel.visible = !self.panel.visible;
        }
        if key == KeyCode::KeyF && pressed {
            let [width, height] = self.size.map(|size| size.max(1) as f32);
            self.fly.frame(width / height);
        }
        self.fly.key(key, pressed);
    }

    fn event(&mut self, event: &WindowEvent) {
        match event {
            // However many sizes a drag goes through, the swapchain is rebuilt once per frame.
            WindowEvent::Resized(size) => {
                self.size = [size.width, size.height];
                self.outdated = true;
            }
            WindowEvent::Occluded(occluded) => self.occluded = *occluded,
            WindowEvent::Focused(false) => {
                self.fly.release();
                self.set_looking(false);
            }
            WindowEvent::MouseInput {
                state,
                button: MouseButton::Right,
                ..
            } => self.set_looking(*state == ElementState::Pressed),
            _ => {}
        }
    }

    /// Grabs the pointer where the system allows it, so that a long look does not leave the window.
    fn set_looking(&mut self, looking: bool) {
        self.looking = looking;
        self.window.set_cursor_visible(!looking);
        let grabbed = if looking {
            let locked = self.window.set_cursor_grab(CursorGrabMode::Locked);
            locked.or_else(|_| self.window.set_cursor_grab(CursorGrabMode::Confined))
        } else {
            self.window.set_cursor_grab(CursorGrabMode::None)
        };
        // Without a grab, looking ends at the edge of the screen, and works otherwise.
        let _ = grabbed;
    }

    /// Draws and presents a frame, unless there is no image to draw into.
    fn draw(&mut self) -> Result<(), PlayerError> {
        let now = Instant::now();
        self.step = (now - self.last).as_secs_f32();
        self.fly.step(self.step);
        self.last = now;
        if self.outdated && !self.rebuild()? {
            return Ok(());
        }
        #[cfg(feature = "hot-reload")]
        self.reload_shaders();
        let mut commands = self.frames.begin()?;
        let index = match self.swapchain.acquire(commands.slot())? {
            Acquired::Image(index) => index,
            Acquired::Outdated => {
                self.outdated = true;
                return Ok(());
            }
            Acquired::NotReady => return Ok(()),
        };
        let target = FrameTarget {
            image: self.swapchain.image(index),
            final_layout: vk::ImageLayout::PRESENT_SRC_KHR,
            final_sync: Sync::NONE,
        };
        #[cfg(feature = "ui")]
        {
            let statistics = Statistics {
                draws: self.renderer.draw_stats(),
                instances: self.package.count(cairn_format::SectionKind::Instances),
                passes: self.frames.timings(),
                uploaded: self.scene.stats.bytes,
                seconds: self.step,
            };
            let (slot, extent) = (commands.slot(), self.swapchain.extent());
            let (state, camera) = (&mut self.state, *self.fly.camera());
            let window = &self.window;
            let go = self
                .panel
                .update(slot, window, extent, state, &camera, &statistics)?;
            if let Some(camera) = go {
                self.fly.go(camera.with_near_for(bounds(self.package)));
            }
        }
        #[cfg(feature = "ui")]
        let panel = |commands: &mut crate::gpu::Commands, image: crate::gpu::ImageRef<'_>| {
            self.panel.record(commands, image);
        };
        #[cfg(feature = "ui")]
        let overlay: Option<crate::frame::Overlay<'_>> = self
            .panel
            .visible
            .then_some(&panel as crate::frame::Overlay<'_>);
        #[cfg(not(feature = "ui"))]
        let overlay = None;
        self.renderer.record_under(
            &mut commands,
            &self.scene,
            self.package,
            self.fly.camera(),
            &self.state.settings,
            target,
            overlay,
        )?;
        self.window.pre_present_notify();
        let fits = self.swapchain.present(&mut self.frames, commands, index)?;
        self.outdated |= !fits;
        self.shown = self.shown.wrapping_add(1);
        Ok(())
    }

    /// Takes shaders that changed on disk; what is wrong with them is logged and shown, and stops nothing.
    #[cfg(feature = "hot-reload")]
    fn reload_shaders(&mut self) {
        let taken = self.reload.look(&mut self.renderer);
        #[cfg(feature = "ui")]
        let taken = taken.and_then(|taken| {
            if taken {
                let rebuilt = self.panel.rebuild_pipeline(self.swapchain.format());
                rebuilt.map_err(|error| error.to_string())?;
                self.panel.error = None;
            }
            Ok(taken)
        });
        match taken {
            Ok(true) => eprintln!("shaders reloaded"),
            Ok(false) => {}
            Err(error) => {
                eprintln!("shaders not reloaded: {error}");
                #[cfg(feature = "ui")]
                {
                    self.panel.error = Some(error);
                }
            }
        }
    }

    /// Fits the swapchain to the window; false where the window has no size.
    fn rebuild(&mut self) -> Result<bool, PlayerError> {
        let before = self.swapchain.extent();
        if !self.swapchain.recreate(self.size)? {
            return Ok(false);
        }
        if self.swapchain.extent() != before {
            self.renderer.resize(&self.gpu, self.swapchain.extent())?;
        }
        self.outdated = false;
        Ok(true)
    }

    /// Keeps what was changed. That it cannot be kept is said, and stops nothing.
    fn keep(&self) {
        let Some(file) = &self.options.state else {
            return;
        };
        let unchanged = self.state.settings == self.options.settings
            && self.state.cameras == self.options.cameras;
        if !unchanged && let Err(error) = self.state.save(file) {
            eprintln!("warning: {error}");
        }
    }

    /// Destroys everything in order; the messages include those about what was left behind.
    fn close(self) -> Vec<String> {
        self.keep();
        let Self {
            renderer,
            #[cfg(feature = "ui")]
            panel,
            scene,
            frames,
            swapchain,
            gpu,
            window,
            ..
        } = self;
        drop(renderer);
        #[cfg(feature = "ui")]
        drop(panel);
        drop(scene);
        drop(frames);
        drop(swapchain);
        let messages = gpu.close();
        drop(window);
        messages
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests;
