//! A real window on the X server or Wayland compositor of the environment, under validation.

use cairn_format::Writer;
use cairn_format::scene::Scene;
use winit::event::StartCause;
use winit::platform::wayland::EventLoopBuilderExtWayland;
use winit::platform::x11::EventLoopBuilderExtX11;

use super::*;
use crate::gpu::test_support;

/// Frames that the test waits for.
const FRAMES: u32 = 60;

/// Passes events on, and asks for another size or visibility between frames.
struct Storm<'a> {
    application: Application<'a>,
    step: u32,
}

impl Storm<'_> {
    fn disturb(&mut self) {
        let Some(view) = &self.application.view else {
            return;
        };
        self.step += 1;
        // Sizes down to one pixel, in no order; several per frame in the first half.
        for repeat in 0..=3 * u32::from(view.shown < FRAMES / 2) {
            let hash = (self.step * 4 + repeat).wrapping_mul(2_654_435_761);
            let size = PhysicalSize::new(1 + (hash >> 8) % 400, 1 + (hash >> 20) % 300);
            let _ = view.window.request_inner_size(size);
        }
        view.window.set_visible(!self.step.is_multiple_of(20));
    }
}

impl ApplicationHandler for Storm<'_> {
    fn new_events(&mut self, _: &ActiveEventLoop, _: StartCause) {
        self.disturb();
    }

    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        self.application.resumed(event_loop);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        self.application.window_event(event_loop, id, event);
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.application.about_to_wait(event_loop);
    }

    fn exiting(&mut self, event_loop: &ActiveEventLoop) {
        self.application.exiting(event_loop);
    }
}

#[test]
fn a_window_survives_a_storm_of_sizes_and_leaves_nothing_behind() {
    if ["DISPLAY", "WAYLAND_DISPLAY"].map(std::env::var_os) == [None, None] {
        eprintln!("SKIPPED: no display (run under xvfb-run)");
        return;
    }
    if test_support::gpu().is_none() {
        return;
    }
    let bytes = Writer::new().to_vec(&Scene::empty("storm"), "test");
    let package = Package::from_bytes(&bytes.expect("written")).expect("opens");
    let options = WindowOptions {
        size: [320, 240],
        camera: Camera::default(),
        settings: Settings::default(),
        frames: Some(FRAMES),
        cameras: Vec::new(),
        state: None,
        panel: true,
        gpu: GpuOptions {
            validation: true,
            device: None,
            ..GpuOptions::default()
        },
    };
    let mut builder = EventLoop::builder();
    EventLoopBuilderExtX11::with_any_thread(&mut builder, true);
    EventLoopBuilderExtWayland::with_any_thread(&mut builder, true);
    let event_loop = builder.build().expect("event loop");
    let mut storm = Storm {
        application: Application::new(&package, &options),
        step: 0,
    };
    event_loop.run_app(&mut storm).expect("runs");
    let messages = storm.application.outcome.expect("no error");
    assert_eq!(messages, Vec::<String>::new());
    assert!(storm.step > FRAMES / 2, "only {} disturbances", storm.step);
}
