//! Presents to a window: surface, swapchain, acquire and present.

use std::ffi::CStr;
use std::sync::Arc;

use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};

use super::command::Commands;
use super::device::{Gpu, GpuOptions, Shared};
use super::error::{GpuError, GpuResult};
use super::frame_sync::{FRAMES_IN_FLIGHT, Frames};
use super::image::ImageRef;
use super::instance::Instance;
use super::queue::Handshake;

/// How long to wait for an image: events must be heard even where the display never gives one.
const ACQUIRE_NANOSECONDS: u64 = 500_000_000;

/// A window that can be presented to.
pub trait WindowHandles: HasDisplayHandle + HasWindowHandle {}
impl<T: HasDisplayHandle + HasWindowHandle> WindowHandles for T {}

/// The part of a window that images are presented to. It keeps the window alive.
pub struct Surface {
    raw: vk::SurfaceKHR,
    loader: khr::surface::Instance,
    /// Both outlive the surface.
    _instance: Arc<Instance>,
    _window: Arc<dyn WindowHandles>,
}

impl Surface {
    fn new(instance: &Arc<Instance>, window: Arc<dyn WindowHandles>) -> GpuResult<Self> {
        let (display_handle, window_handle) = raw_handles(window.as_ref())?;
        let loader = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the instance has the extensions of this display, and both it and the window outlive the surface.
        let raw = unsafe {
            ash_window::create_surface(
                &instance.entry,
                &instance.raw,
                display_handle,
                window_handle,
                None,
            )
        }
        .map_err(|result| GpuError::Surface(format!("vkCreateSurfaceKHR: {result}")))?;
        Ok(Self {
            raw,
            loader,
            _instance: instance.clone(),
            _window: window,
        })
    }

    fn presents(&self, device: vk::PhysicalDevice, family: u32) -> bool {
        // SAFETY: device and surface belong to the same living instance.
        let supported = unsafe {
            self.loader
                .get_physical_device_surface_support(device, family, self.raw)
        };
        supported.unwrap_or(false)
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: the swapchain that owned this surface was destroyed before it.
        unsafe { self.loader.destroy_surface(self.raw, None) };
    }
}

impl Gpu {
    /// Opens a device that can present to `window`.
    ///
    /// # Errors
    /// As [`Gpu::new`], and `Surface`.
    pub fn for_window(
        options: &GpuOptions,
        window: Arc<dyn WindowHandles>,
    ) -> GpuResult<(Self, Surface)> {
        let (display, _) = raw_handles(window.as_ref())?;
        let required = ash_window::enumerate_required_extensions(display)
            .map_err(|result| GpuError::Surface(format!("unknown display: {result}")))?;
        let extensions: Vec<&CStr> = required
            .iter()
            // SAFETY: these are names of extensions, static C strings.
            .map(|name| unsafe { CStr::from_ptr(*name) })
            .collect();
        let instance = Arc::new(Instance::new(options.validation, &extensions)?);
        let surface = Surface::new(&instance, window)?;
        let presents = |device, family| surface.presents(device, family);
        let gpu = Self::open(instance, options, Some(&presents))?;
        Ok((gpu, surface))
    }
}

fn raw_handles(window: &dyn WindowHandles) -> GpuResult<(RawDisplayHandle, RawWindowHandle)> {
    let error = |error: raw_window_handle::HandleError| GpuError::Surface(error.to_string());
    Ok((
        window.display_handle().map_err(error)?.as_raw(),
        window.window_handle().map_err(error)?.as_raw(),
    ))
}

/// An image of the swapchain with its view.
struct Target {
    image: vk::Image,
    view: vk::ImageView,
    /// Signalled by the frame that was rendered to this image, waited for by its presentation.
    finished: vk::Semaphore,
}

/// What `acquire` found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Acquired {
    /// Render to this image.
    Image(u32),
    /// The window changed: recreate the swapchain first.
    Outdated,
    /// The display has no image to give, as for a hidden window: try again.
    NotReady,
}

/// The images of a window.
pub struct Swapchain {
    shared: Arc<Shared>,
    loader: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    targets: Vec<Target>,
    /// One per frame in flight: signalled when its image may be written.
    acquired: [vk::Semaphore; FRAMES_IN_FLIGHT],
    format: vk::SurfaceFormatKHR,
    extent: [u32; 2],
    /// Dropped last.
    surface: Surface,
}

impl Swapchain {
    /// A swapchain without images: call [`Swapchain::recreate`].
    ///
    /// # Errors
    /// `Surface` where the window has no sRGB format.
    pub fn new(gpu: &Gpu, surface: Surface) -> GpuResult<Self> {
        let shared = gpu.shared.clone();
        let format = choose_format(&shared, &surface)?;
        let mut swapchain = Self {
            loader: khr::swapchain::Device::new(&shared.instance.raw, &shared.device),
            raw: vk::SwapchainKHR::null(),
            targets: Vec::new(),
            acquired: [vk::Semaphore::null(); FRAMES_IN_FLIGHT],
            format,
            extent: [0, 0],
            surface,
            shared,
        };
        for index in 0..FRAMES_IN_FLIGHT {
            swapchain.acquired[index] = semaphore(&swapchain.shared)?;
        }
        Ok(swapchain)
    }

    /// Format of the images.
    pub fn format(&self) -> vk::Format {
        self.format.format
    }

    /// Size of the images; zero before the first [`Swapchain::recreate`] and while the window is minimised.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Replaces the images by ones of the window's size (`window_extent` where the surface has none of its own),
    /// after the queue is idle. False where the window is minimised: then there are no images.
    pub fn recreate(&mut self, window_extent: [u32; 2]) -> GpuResult<bool> {
        self.shared.wait_idle()?;
        let capabilities = self.capabilities()?;
        self.extent = choose_extent(&capabilities, window_extent);
        self.destroy_targets();
        if self.extent.contains(&0) {
            self.destroy_raw();
            return Ok(false);
        }
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface.raw)
            .min_image_count(choose_count(&capabilities))
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(vk::Extent2D {
                width: self.extent[0],
                height: self.extent[1],
            })
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(choose_alpha(&capabilities))
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true)
            .old_swapchain(self.raw);
        // SAFETY: the queue is idle; surface and old swapchain are alive.
        let raw = unsafe { self.loader.create_swapchain(&info, None) }
            .map_err(GpuError::of("vkCreateSwapchainKHR"));
        self.destroy_raw();
        self.raw = raw?;
        self.create_targets()?;
        Ok(true)
    }

    /// Waits for an image that the frame of `commands` may render to.
    pub fn acquire(&mut self, slot: usize) -> GpuResult<Acquired> {
        if self.targets.is_empty() {
            return Ok(Acquired::Outdated);
        }
        // SAFETY: the semaphore's last wait belongs to the frame that used this slot before, which has finished.
        let result = unsafe {
            self.loader.acquire_next_image(
                self.raw,
                ACQUIRE_NANOSECONDS,
                self.acquired[slot],
                vk::Fence::null(),
            )
        };
        match result {
            // A suboptimal image still counts as acquired; presenting it reports the change again.
            Ok((index, _)) => Ok(Acquired::Image(index)),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(Acquired::Outdated),
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => Ok(Acquired::NotReady),
            Err(other) => Err(GpuError::of("vkAcquireNextImageKHR")(other)),
        }
    }

    /// An acquired image, in layout `UNDEFINED`.
    pub fn image(&self, index: u32) -> ImageRef<'_> {
        let target = &self.targets[index as usize];
        ImageRef::new(target.image, target.view, self.format.format, self.extent)
    }

    /// Submits the frame that rendered to image `index` and left it in `PRESENT_SRC_KHR`, and presents it. False
    /// where the window changed: recreate the swapchain.
    pub fn present(
        &mut self,
        frames: &mut Frames,
        commands: Commands,
        index: u32,
    ) -> GpuResult<bool> {
        let finished = self.targets[index as usize].finished;
        let handshake = Handshake {
            acquired: self.acquired[commands.slot()],
            finished,
        };
        frames.submit_with(commands, Some(&handshake))?;
        let (semaphores, swapchains, indices) = ([finished], [self.raw], [index]);
        let info = vk::PresentInfoKHR::default()
            .wait_semaphores(&semaphores)
            .swapchains(&swapchains)
            .image_indices(&indices);
        let _queue = self.shared.timeline();
        // SAFETY: the lock keeps other threads off the queue; the image was acquired and its frame submitted.
        match unsafe { self.loader.queue_present(self.shared.queue, &info) } {
            Ok(suboptimal) => Ok(!suboptimal),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(false),
            Err(other) => Err(GpuError::of("vkQueuePresentKHR")(other)),
        }
    }

    fn capabilities(&self) -> GpuResult<vk::SurfaceCapabilitiesKHR> {
        // SAFETY: physical device and surface belong to the same living instance.
        unsafe {
            self.surface
                .loader
                .get_physical_device_surface_capabilities(self.shared.physical, self.surface.raw)
        }
        .map_err(GpuError::of("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))
    }

    fn create_targets(&mut self) -> GpuResult<()> {
        // SAFETY: the swapchain is alive.
        let images = unsafe { self.loader.get_swapchain_images(self.raw) }
            .map_err(GpuError::of("vkGetSwapchainImagesKHR"))?;
        for image in images {
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(self.format.format)
                .subresource_range(vk::ImageSubresourceRange {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    base_mip_level: 0,
                    level_count: 1,
                    base_array_layer: 0,
                    layer_count: 1,
                });
            let finished = semaphore(&self.shared)?;
            // SAFETY: the image belongs to the living swapchain.
            let view = unsafe { self.shared.device.create_image_view(&info, None) };
            // Pushed even without a view, so that the semaphore is destroyed with the rest.
            self.targets.push(Target {
                image,
                view: *view.as_ref().unwrap_or(&vk::ImageView::null()),
                finished,
            });
            view.map_err(GpuError::of("vkCreateImageView"))?;
            self.shared.set_name(image, "swapchain");
        }
        Ok(())
    }

    fn destroy_targets(&mut self) {
        for target in self.targets.drain(..) {
            // SAFETY: the queue is idle, so neither view nor semaphore is in use.
            unsafe {
                self.shared.device.destroy_image_view(target.view, None);
                self.shared.device.destroy_semaphore(target.finished, None);
            }
        }
    }

    fn destroy_raw(&mut self) {
        // SAFETY: the queue is idle; a null swapchain is ignored.
        unsafe { self.loader.destroy_swapchain(self.raw, None) };
        self.raw = vk::SwapchainKHR::null();
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // A lost device is idle as well.
        let _ = self.shared.wait_idle();
        self.destroy_targets();
        self.destroy_raw();
        for semaphore in self.acquired {
            // SAFETY: the queue is idle.
            unsafe { self.shared.device.destroy_semaphore(semaphore, None) };
        }
    }
}

fn semaphore(shared: &Shared) -> GpuResult<vk::Semaphore> {
    // SAFETY: the device is alive.
    unsafe {
        shared
            .device
            .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
    }
    .map_err(GpuError::of("vkCreateSemaphore"))
}

fn choose_format(shared: &Shared, surface: &Surface) -> GpuResult<vk::SurfaceFormatKHR> {
    // SAFETY: physical device and surface belong to the same living instance.
    let formats = unsafe {
        surface
            .loader
            .get_physical_device_surface_formats(shared.physical, surface.raw)
    }
    .map_err(GpuError::of("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
    prefer_srgb(&formats).ok_or_else(|| GpuError::Surface("the window has no sRGB format".into()))
}

fn prefer_srgb(formats: &[vk::SurfaceFormatKHR]) -> Option<vk::SurfaceFormatKHR> {
    let wanted = [
        vk::Format::B8G8R8A8_SRGB,
        vk::Format::R8G8B8A8_SRGB,
        vk::Format::A8B8G8R8_SRGB_PACK32,
    ];
    wanted.into_iter().find_map(|wanted| {
        formats.iter().copied().find(|format| {
            format.format == wanted && format.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
        })
    })
}

/// The surface's size where it has one, else the window's within the surface's bounds.
fn choose_extent(capabilities: &vk::SurfaceCapabilitiesKHR, window: [u32; 2]) -> [u32; 2] {
    let current = capabilities.current_extent;
    if current.width != u32::MAX {
        return [current.width, current.height];
    }
    if window.contains(&0) {
        return [0, 0];
    }
    let (min, max) = (capabilities.min_image_extent, capabilities.max_image_extent);
    [
        window[0].max(min.width).min(max.width),
        window[1].max(min.height).min(max.height),
    ]
}

/// One more than the least, so that acquiring seldom waits for the display.
fn choose_count(capabilities: &vk::SurfaceCapabilitiesKHR) -> u32 {
    let wanted = capabilities.min_image_count.saturating_add(1);
    match capabilities.max_image_count {
        0 => wanted,
        max => wanted.min(max),
    }
}

fn choose_alpha(capabilities: &vk::SurfaceCapabilitiesKHR) -> vk::CompositeAlphaFlagsKHR {
    let choices = [
        vk::CompositeAlphaFlagsKHR::OPAQUE,
        vk::CompositeAlphaFlagsKHR::INHERIT,
        vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED,
    ];
    let supported = capabilities.supported_composite_alpha;
    choices
        .into_iter()
        .find(|choice| supported.contains(*choice))
        .unwrap_or(vk::CompositeAlphaFlagsKHR::POST_MULTIPLIED)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capabilities(current: u32) -> vk::SurfaceCapabilitiesKHR {
        let square = |size| vk::Extent2D {
            width: size,
            height: size,
        };
        vk::SurfaceCapabilitiesKHR {
            min_image_count: 3,
            max_image_count: 3,
            current_extent: square(current),
            min_image_extent: square(16),
            max_image_extent: square(4096),
            ..Default::default()
        }
    }

    #[test]
    fn the_extent_is_the_surfaces_or_the_windows() {
        assert_eq!(choose_extent(&capabilities(800), [1, 1]), [800, 800]);
        assert_eq!(choose_extent(&capabilities(0), [640, 480]), [0, 0]);
        let free = capabilities(u32::MAX);
        assert_eq!(choose_extent(&free, [640, 480]), [640, 480]);
        assert_eq!(choose_extent(&free, [4, 9000]), [16, 4096]);
        assert_eq!(choose_extent(&free, [0, 480]), [0, 0]);
    }

    #[test]
    fn the_image_count_stays_within_the_bounds() {
        assert_eq!(choose_count(&capabilities(1)), 3);
        let unbounded = vk::SurfaceCapabilitiesKHR {
            max_image_count: 0,
            ..capabilities(1)
        };
        assert_eq!(choose_count(&unbounded), 4);
    }

    #[test]
    fn only_srgb_formats_are_taken() {
        let format = |format| vk::SurfaceFormatKHR {
            format,
            color_space: vk::ColorSpaceKHR::SRGB_NONLINEAR,
        };
        let unorm = format(vk::Format::B8G8R8A8_UNORM);
        let (rgba, bgra) = (
            format(vk::Format::R8G8B8A8_SRGB),
            format(vk::Format::B8G8R8A8_SRGB),
        );
        assert_eq!(prefer_srgb(&[unorm, rgba, bgra]), Some(bgra));
        assert_eq!(prefer_srgb(&[unorm, rgba]), Some(rgba));
        assert_eq!(prefer_srgb(&[unorm]), None);
    }
}
