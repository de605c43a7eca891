//! The Vulkan instance: loader, layers, debug messages.

use std::ffi::{CStr, c_char, c_void};
use std::sync::{Arc, Mutex, PoisonError};

use ash::{ext, vk};

use super::error::{GpuError, GpuResult};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of the validation layer, in order.
pub(super) type Messages = Arc<Mutex<Vec<String>>>;

/// The loaded loader, the instance, the messenger. Everything created from it holds an `Arc` of it.
pub(super) struct Instance {
    pub(super) entry: ash::Entry,
    pub(super) raw: ash::Instance,
    pub(super) debug_utils: bool,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(super) messages: Messages,
}

impl Instance {
    /// Loads Vulkan and creates an instance of version 1.3 with `extensions`, all of which must exist.
    ///
    /// # Errors
    /// `NoLoader`, `OldLoader`, `NoDriver`, `NoValidationLayer`, `NoExtension`.
    pub(super) fn new(validation: bool, extensions: &[&CStr]) -> GpuResult<Self> {
        // SAFETY: libvulkan is loaded as every Vulkan program does; its initialisers have no preconditions.
        let entry =
            unsafe { ash::Entry::load() }.map_err(|error| GpuError::NoLoader(error.to_string()))?;
        check_version(&entry)?;
        if validation && !has_validation_layer(&entry)? {
            return Err(GpuError::NoValidationLayer);
        }
        let layer = validation.then_some(VALIDATION_LAYER);
        let mut available = extension_names(&entry, None)?;
        if layer.is_some() {
            available.extend(extension_names(&entry, layer)?);
        }
        let has = |name: &CStr| {
            available
                .iter()
                .any(|extension| extension.as_c_str() == name)
        };
        let mut enabled: Vec<*const c_char> = Vec::new();
        for name in extensions {
            if !has(name) {
                return Err(GpuError::NoExtension(name.to_string_lossy().into_owned()));
            }
            enabled.push(name.as_ptr());
        }
        let debug_utils = has(ext::debug_utils::NAME);
        if debug_utils {
            enabled.push(ext::debug_utils::NAME.as_ptr());
        }
        if layer.is_some() && has(ext::validation_features::NAME) {
            enabled.push(ext::validation_features::NAME.as_ptr());
        }
        Self::create(entry, layer, &enabled, debug_utils)
    }

    fn create(
        entry: ash::Entry,
        layer: Option<&CStr>,
        extensions: &[*const c_char],
        debug_utils: bool,
    ) -> GpuResult<Self> {
        let messages = Messages::default();
        let application = vk::ApplicationInfo::default()
            .application_name(c"cairn-player")
            .engine_name(c"cairn")
            .api_version(vk::API_VERSION_1_3);
        let layers: Vec<*const c_char> = layer.iter().map(|name| name.as_ptr()).collect();
        let mut messenger_info = messenger_info(&messages);
        let enables = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features =
            vk::ValidationFeaturesEXT::default().enabled_validation_features(&enables);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(extensions);
        if layer.is_some() {
            info = info.push_next(&mut features);
            if debug_utils {
                info = info.push_next(&mut messenger_info);
            }
        }
        // SAFETY: `info` and all it points to live until the call returns; layers and extensions exist.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => GpuError::NoDriver,
            other => GpuError::of("vkCreateInstance")(other),
        })?;
        let mut instance = Self {
            entry,
            raw,
            debug_utils,
            messenger: None,
            messages,
        };
        if layer.is_some() && debug_utils {
            instance.create_messenger()?;
        }
        Ok(instance)
    }

    fn create_messenger(&mut self) -> GpuResult<()> {
        let loader = ext::debug_utils::Instance::new(&self.entry, &self.raw);
        let info = messenger_info(&self.messages);
        // SAFETY: the user data points into `self.messages`, which outlives the messenger.
        let messenger = unsafe { loader.create_debug_utils_messenger(&info, None) }
            .map_err(GpuError::of("vkCreateDebugUtilsMessengerEXT"))?;
        self.messenger = Some((loader, messenger));
        Ok(())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: everything made from the instance held an `Arc` of it and is gone; the messages are dropped
        // after this body, so the layer may still report while the instance is destroyed.
        unsafe {
            if let Some((loader, messenger)) = self.messenger.take() {
                loader.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

fn check_version(entry: &ash::Entry) -> GpuResult<()> {
    // SAFETY: the loader is loaded; the call has no other precondition.
    let version = unsafe { entry.try_enumerate_instance_version() }
        .map_err(GpuError::of("vkEnumerateInstanceVersion"))?
        .unwrap_or(vk::API_VERSION_1_0);
    if version < vk::API_VERSION_1_3 {
        return Err(GpuError::OldLoader(version_text(version)));
    }
    Ok(())
}

/// `major.minor.patch` of a Vulkan version number.
pub(super) fn version_text(version: u32) -> String {
    format!(
        "{}.{}.{}",
        vk::api_version_major(version),
        vk::api_version_minor(version),
        vk::api_version_patch(version)
    )
}

fn has_validation_layer(entry: &ash::Entry) -> GpuResult<bool> {
    // SAFETY: the loader is loaded; the call has no other precondition.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }
        .map_err(GpuError::of("vkEnumerateInstanceLayerProperties"))?;
    Ok(layers
        .iter()
        .any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER)))
}

fn extension_names(entry: &ash::Entry, layer: Option<&CStr>) -> GpuResult<Vec<std::ffi::CString>> {
    // SAFETY: the loader is loaded; the layer, where given, was enumerated.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(layer) }
        .map_err(GpuError::of("vkEnumerateInstanceExtensionProperties"))?;
    Ok(extensions
        .iter()
        .filter_map(|extension| extension.extension_name_as_c_str().ok())
        .map(CStr::to_owned)
        .collect())
}

fn messenger_info(messages: &Messages) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    type Severity = vk::DebugUtilsMessageSeverityFlagsEXT;
    type Kind = vk::DebugUtilsMessageTypeFlagsEXT;
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(Severity::WARNING | Severity::ERROR)
        .message_type(Kind::VALIDATION | Kind::PERFORMANCE)
        .pfn_user_callback(Some(on_message))
        .user_data(Arc::as_ptr(messages).cast_mut().cast())
}

/// Collects a message and prints it.
unsafe extern "system" fn on_message(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes valid callback data; its message is null or a C string.
    let text = unsafe {
        let message = (*data).p_message;
        if message.is_null() {
            String::new()
        } else {
            CStr::from_ptr(message).to_string_lossy().into_owned()
        }
    };
    let text = format!("{severity:?}: {text}");
    eprintln!("vulkan {text}");
    // SAFETY: the user data is the mutex given to `messenger_info`, alive as long as the instance.
    let messages = unsafe { &*user_data.cast::<Mutex<Vec<String>>>() };
    messages
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(text);
    vk::FALSE
}
