//! Compiled pipelines on disk: one file per device and driver, ignored where it is damaged or another driver's.

use std::path::{Path, PathBuf};

use ash::vk;

use super::error::{GpuError, GpuResult};
use crate::png::write_whole;

/// Before the driver's data: this, a checksum and the length, little-endian.
const MAGIC: &[u8; 8] = b"CairnPC1";
const PREFIX: usize = 24;

/// A cache object, and the file that it came from and goes to.
pub(super) struct PipelineCache {
    pub(super) raw: vk::PipelineCache,
    file: Option<PathBuf>,
    /// Of the data that was read; nothing is written where nothing changed.
    checksum: u64,
}

impl PipelineCache {
    /// Begins with what `folder` holds for this device; empty without a folder.
    pub(super) fn new(
        device: &ash::Device,
        properties: &vk::PhysicalDeviceProperties,
        folder: Option<&Path>,
    ) -> GpuResult<Self> {
        let file = folder.map(|folder| folder.join(file_name(properties)));
        let bytes = file
            .as_deref()
            .and_then(|file| std::fs::read(file).ok())
            .unwrap_or_default();
        let data = unpack(&bytes)
            .filter(|data| fits(data, properties))
            .unwrap_or_default();
        let create = |data: &[u8]| {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: the device is alive; the data, where there is any, is what this driver gave out, by its header
            // and by our checksum.
            unsafe { device.create_pipeline_cache(&info, None) }
        };
        let raw = create(data).or_else(|_| create(&[]));
        Ok(Self {
            raw: raw.map_err(GpuError::of("vkCreatePipelineCache"))?,
            file,
            checksum: checksum(data),
        })
    }

    /// Writes what was compiled since, and destroys the object. A failure to write only costs time.
    pub(super) fn close(&self, device: &ash::Device) {
        if let Some(file) = &self.file {
            // SAFETY: the cache is alive and no other thread uses it.
            let data = unsafe { device.get_pipeline_cache_data(self.raw) }.unwrap_or_default();
            if !data.is_empty() && checksum(&data) != self.checksum {
                let written = file
                    .parent()
                    .map_or(Ok(()), std::fs::create_dir_all)
                    .and_then(|()| write_whole(file, &pack(&data)));
                drop(written);
            }
        }
        // SAFETY: nothing uses the cache any more.
        unsafe { device.destroy_pipeline_cache(self.raw, None) };
    }
}

fn file_name(properties: &vk::PhysicalDeviceProperties) -> String {
    let uuid = properties
        .pipeline_cache_uuid
        .map(|byte| format!("{byte:02x}"))
        .concat();
    format!(
        "pipelines-{:04x}-{:04x}-{uuid}.bin",
        properties.vendor_id, properties.device_id
    )
}

/// FNV-1a, 64 bits: finds damage, not malice.
fn checksum(data: &[u8]) -> u64 {
    data.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

fn pack(data: &[u8]) -> Vec<u8> {
    let (sum, length) = (
        checksum(data).to_le_bytes(),
        (data.len() as u64).to_le_bytes(),
    );
    [&MAGIC[..], &sum, &length, data].concat()
}

fn unpack(bytes: &[u8]) -> Option<&[u8]> {
    let data = bytes.get(PREFIX..)?;
    (bytes == pack(data)).then_some(data)
}

/// The header that Vulkan prescribes (version 1): length, version, vendor, device, UUID.
fn fits(data: &[u8], properties: &vk::PhysicalDeviceProperties) -> bool {
    let words = [32, 1, properties.vendor_id, properties.device_id].map(u32::to_le_bytes);
    let expected = [words.concat().as_slice(), &properties.pipeline_cache_uuid].concat();
    data.starts_with(&expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Gpu, GpuOptions, test_support};

    #[test]
    fn damage_and_other_drivers_are_found() {
        let properties = vk::PhysicalDeviceProperties {
            vendor_id: 7,
            device_id: 9,
            pipeline_cache_uuid: [3; 16],
            ..Default::default()
        };
        let words = [32, 1, 7, 9].map(u32::to_le_bytes).concat();
        let data = [words.as_slice(), &[3; 16], b"pipelines"].concat();
        assert!(fits(&data, &properties));
        assert!(!fits(
            &data,
            &vk::PhysicalDeviceProperties {
                device_id: 8,
                ..properties
            }
        ));
        let bytes = pack(&data);
        assert_eq!(unpack(&bytes), Some(data.as_slice()));
        assert_eq!(unpack(&bytes[..bytes.len() - 1]), None);
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            assert_eq!(unpack(&damaged), None, "byte {at}");
        }
        assert_eq!(unpack(b""), None);
    }

    #[test]
    fn the_file_is_written_once_and_survives_damage() {
        if test_support::gpu().is_none() {
            return;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let options = GpuOptions {
            validation: true,
            cache: Some(folder.path().join("below")),
            ..GpuOptions::default()
        };
        let files = || -> Vec<PathBuf> {
            let entries = std::fs::read_dir(folder.path().join("below")).expect("a folder");
            entries
                .map(|entry| entry.expect("an entry").path())
                .collect()
        };
        test_support::close_clean(Gpu::new(&options).expect("a device"));
        let written = files();
        assert_eq!(written.len(), 1, "{written:?}");
        let good = std::fs::read(&written[0]).expect("the file");
        assert!(unpack(&good).is_some());
        std::fs::write(&written[0], &good[..good.len() / 2]).expect("damaged");
        test_support::close_clean(Gpu::new(&options).expect("a device"));
        assert!(unpack(&std::fs::read(&written[0]).expect("the file")).is_some());
        assert_eq!(files(), written);
    }
}
