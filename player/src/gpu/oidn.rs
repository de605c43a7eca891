//! Open Image Denoise 2, opened at run time: its filter `RT` with albedo and normal as guides.
//!
//! The C interface is described in <https://www.openimagedenoise.org/documentation.html>.

use std::ffi::{CStr, OsString, c_char, c_int, c_void};
use std::ptr::NonNull;

use libloading::Library;

use crate::PlayerError;

/// Names that the library is looked for by, where `CAIRN_OIDN` names no file.
const NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
};
/// Environment variable: the file to open instead.
const VARIABLE: &str = "CAIRN_OIDN";

/// `OIDN_DEVICE_TYPE_DEFAULT`: the fastest device that there is.
const DEVICE_DEFAULT: c_int = 0;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;
/// Bytes of a texel: the fourth float is skipped.
const TEXEL: usize = 16;

/// A failure of Open Image Denoise.
#[derive(Debug, thiserror::Error)]
pub enum OidnError {
    /// No file of the library can be opened, or it is not version 2.
    #[error(
        "--path-denoise: no Open Image Denoise 2 ({0}): install it, or set CAIRN_OIDN to the path of \
         libOpenImageDenoise.so.2, or leave the option out"
    )]
    NoLibrary(String),
    /// A call failed.
    #[error("Open Image Denoise failed: {0}")]
    Failed(String),
}

type Object = NonNull<c_void>;
type Pointer = *mut c_void;

/// Declares the functions that are used, and how they are found.
macro_rules! functions {
    ($($name:ident = $symbol:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        #[derive(Clone, Copy)]
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn find(library: &Library) -> Result<Self, libloading::Error> {
                Ok(Self {
                    $($name: {
                        // SAFETY: the signature is that of the C header of version 2, which has this symbol.
                        *unsafe { library.get($symbol) }?
                    },)*
                })
            }
        }
    };
}

functions! {
    new_device = b"oidnNewDevice\0": fn(c_int) -> Pointer;
    commit_device = b"oidnCommitDevice\0": fn(Pointer);
    release_device = b"oidnReleaseDevice\0": fn(Pointer);
    device_error = b"oidnGetDeviceError\0": fn(Pointer, *mut *const c_char) -> c_int;
    new_buffer = b"oidnNewBuffer\0": fn(Pointer, usize) -> Pointer;
    write_buffer = b"oidnWriteBuffer\0": fn(Pointer, usize, usize, *const c_void);
    read_buffer = b"oidnReadBuffer\0": fn(Pointer, usize, usize, Pointer);
    release_buffer = b"oidnReleaseBuffer\0": fn(Pointer);
    new_filter = b"oidnNewFilter\0": fn(Pointer, *const c_char) -> Pointer;
    set_image = b"oidnSetFilterImage\0":
        fn(Pointer, *const c_char, Pointer, c_int, usize, usize, usize, usize, usize);
    set_bool = b"oidnSetFilterBool\0": fn(Pointer, *const c_char, bool);
    commit_filter = b"oidnCommitFilter\0": fn(Pointer);
    execute_filter = b"oidnExecuteFilter\0": fn(Pointer);
    release_filter = b"oidnReleaseFilter\0": fn(Pointer);
}

/// A device of the library.
pub struct Denoiser {
    functions: Functions,
    device: Object,
}

impl Denoiser {
    /// Opens the library that `CAIRN_OIDN` names, or the system's.
    ///
    /// # Errors
    /// [`OidnError`].
    pub fn open() -> Result<Self, PlayerError> {
        let names = match std::env::var_os(VARIABLE) {
            Some(file) => vec![file],
            None => NAMES.iter().map(OsString::from).collect(),
        };
        Ok(Self::open_first(&names)?)
    }

    fn open_first(names: &[OsString]) -> Result<Self, OidnError> {
        let mut reasons = Vec::new();
        for name in names {
            match load(name) {
                Ok(functions) => return Self::new(functions),
                Err(error) => reasons.push(error.to_string()),
            }
        }
        Err(OidnError::NoLibrary(reasons.join("; ")))
    }

    fn new(functions: Functions) -> Result<Self, OidnError> {
        // SAFETY: the library stays loaded, and any integer is allowed: unknown types give null.
        let device = NonNull::new(unsafe { (functions.new_device)(DEVICE_DEFAULT) });
        let Some(device) = device else {
            // SAFETY: null asks for the thread's error.
            return Err(unsafe { error_of(&functions, std::ptr::null_mut()) }
                .unwrap_or_else(|| OidnError::Failed("no device".into())));
        };
        let denoiser = Self { functions, device };
        // SAFETY: the device is alive.
        unsafe { (functions.commit_device)(device.as_ptr()) };
        denoiser.check()?;
        Ok(denoiser)
    }

    /// Denoises linear radiance in place; A is kept. `guides` are the means of albedo and of unit normals. They are
    /// denoised first, so that the filter may trust them.
    ///
    /// # Errors
    /// [`OidnError`], such as too little memory; `color` is then as it was.
    ///
    /// # Panics
    /// Where an image has not `size` texels.
    pub fn denoise(
        &self,
        size: [u32; 2],
        color: &mut [[f32; 4]],
        guides: &[Vec<[f32; 4]>; 2],
    ) -> Result<(), PlayerError> {
        let texels = size[0] as usize * size[1] as usize;
        let same = |image: &[[f32; 4]]| image.len() == texels;
        assert!(same(color) && guides.iter().all(|guide| same(guide)));
        let [albedo, normal] = [self.buffer(&guides[0])?, self.buffer(&guides[1])?];
        let radiance = self.buffer(color)?;
        for (name, guide) in [(c"albedo", &albedo), (c"normal", &normal)] {
            self.filter(size, &[(name, guide), (c"output", guide)], &[])?;
        }
        let images = [
            (c"color", &radiance),
            (c"albedo", &albedo),
            (c"normal", &normal),
            (c"output", &radiance),
        ];
        self.filter(size, &images, &[c"hdr", c"cleanAux"])?;
        let mut denoised = vec![[0.0f32; 4]; texels];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut denoised);
        // SAFETY: the buffer holds as many bytes as the slice, which is writable.
        unsafe {
            (self.functions.read_buffer)(
                radiance.object.as_ptr(),
                0,
                bytes.len(),
                bytes.as_mut_ptr().cast(),
            );
        }
        self.check()?;
        for (texel, new) in color.iter_mut().zip(denoised) {
            texel[..3].copy_from_slice(&new[..3]);
        }
        Ok(())
    }

    /// Runs a filter `RT` to its end.
    fn filter(
        &self,
        [width, height]: [u32; 2],
        images: &[(&CStr, &DenoiseBuffer<'_>)],
        switches: &[&CStr],
    ) -> Result<(), OidnError> {
        let functions = &self.functions;
        let (width, height) = (width as usize, height as usize);
        // SAFETY: the device is alive, and the name a C string.
        let filter = unsafe { (functions.new_filter)(self.device.as_ptr(), c"RT".as_ptr()) };
        let Some(filter) = NonNull::new(filter) else {
            return Err(self.failure("no filter `RT`"));
        };
        let filter = filter.as_ptr();
        // SAFETY: the filter lives until its release below; the buffers belong to the same device, outlive this call
        // and hold `width` x `height` texels of `TEXEL` bytes; names are C strings.
        unsafe {
            for (name, buffer) in images {
                let buffer = buffer.object.as_ptr();
                let (name, row) = (name.as_ptr(), width * TEXEL);
                (functions.set_image)(filter, name, buffer, FLOAT3, width, height, 0, TEXEL, row);
            }
            for name in switches {
                (functions.set_bool)(filter, name.as_ptr(), true);
            }
            (functions.commit_filter)(filter);
            (functions.execute_filter)(filter);
            (functions.release_filter)(filter);
        }
        self.check()
    }

    fn buffer(&self, texels: &[[f32; 4]]) -> Result<DenoiseBuffer<'_>, OidnError> {
        let bytes: &[u8] = bytemuck::cast_slice(texels);
        // SAFETY: the device is alive.
        let buffer = unsafe { (self.functions.new_buffer)(self.device.as_ptr(), bytes.len()) };
        let Some(object) = NonNull::new(buffer) else {
            return Err(self.failure("no memory"));
        };
        let buffer = DenoiseBuffer {
            denoiser: self,
            object,
        };
        self.check()?;
        // SAFETY: the buffer holds as many bytes as the slice.
        unsafe {
            (self.functions.write_buffer)(
                buffer.object.as_ptr(),
                0,
                bytes.len(),
                bytes.as_ptr().cast(),
            );
        }
        self.check()?;
        Ok(buffer)
    }

    fn check(&self) -> Result<(), OidnError> {
        // SAFETY: the device is alive.
        unsafe { error_of(&self.functions, self.device.as_ptr()) }.map_or(Ok(()), Err)
    }

    fn failure(&self, what: &str) -> OidnError {
        self.check()
            .err()
            .unwrap_or_else(|| OidnError::Failed(what.into()))
    }
}

impl Drop for Denoiser {
    fn drop(&mut self) {
        // SAFETY: the device is alive, and nothing uses it any more: buffers borrow `self`.
        unsafe { (self.functions.release_device)(self.device.as_ptr()) };
    }
}

/// Memory of the device.
struct DenoiseBuffer<'a> {
    denoiser: &'a Denoiser,
    object: Object,
}

impl Drop for DenoiseBuffer<'_> {
    fn drop(&mut self) {
        // SAFETY: the buffer is alive, and filters that used it are released.
        unsafe { (self.denoiser.functions.release_buffer)(self.object.as_ptr()) };
    }
}

/// Opens the library, which is never closed: its threads may outlive a device.
fn load(name: &OsString) -> Result<Functions, libloading::Error> {
    // SAFETY: its initialisers are those of a well-known library, or of what the user named.
    let library = unsafe { Library::new(name) }?;
    let functions = Functions::find(&library)?;
    std::mem::forget(library);
    Ok(functions)
}

/// The first error since the last call, which forgets it.
///
/// # Safety
/// `device` must be alive, or null for the thread's error.
unsafe fn error_of(functions: &Functions, device: Pointer) -> Option<OidnError> {
    let mut message = std::ptr::null();
    // SAFETY: the caller vouches for the device; `message` outlives the call.
    let code = unsafe { (functions.device_error)(device, &mut message) };
    if code == 0 {
        return None;
    }
    if message.is_null() {
        return Some(OidnError::Failed(format!("error {code}")));
    }
    // SAFETY: not null, so it is a C string that is valid until the thread's next call.
    let message = unsafe { CStr::from_ptr(message) }.to_string_lossy();
    Some(OidnError::Failed(format!("{message} (error {code})")))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The denoiser, or a loud skip.
    pub fn denoiser(test: &str) -> Option<Denoiser> {
        match Denoiser::open() {
            Ok(denoiser) => Some(denoiser),
            Err(error) => {
                let named = std::env::var_os(VARIABLE).is_some();
                assert!(!named, "{VARIABLE} is set, but: {error}");
                eprintln!("SKIPPED: {test}: {error}");
                None
            }
        }
    }

    #[test]
    fn a_missing_library_is_named_with_a_remedy() {
        let names = ["/nowhere/libOpenImageDenoise.so.2".into()];
        let Err(error) = Denoiser::open_first(&names) else {
            panic!("opened nothing")
        };
        let text = error.to_string();
        assert!(
            text.contains("/nowhere/libOpen") && text.contains(VARIABLE),
            "{text}"
        );
        assert_eq!(PlayerError::from(error).exit_code(), 1);
    }

    #[test]
    fn another_library_is_refused() {
        let Err(error) = Denoiser::open_first(&["libc.so.6".into()]) else {
            panic!("the C library does not denoise")
        };
        assert!(error.to_string().contains("oidnNewDevice"), "{error}");
    }

    /// Noise over an edge that only the albedo shows: the noise goes, the edge, A and brightness above 1 stay.
    #[test]
    fn noise_goes_and_edges_stay() {
        let Some(denoiser) = denoiser("noise_goes_and_edges_stay") else {
            return;
        };
        const SIDE: u32 = 64;
        let albedo = |x: u32| if x < SIDE / 2 { 0.2 } else { 0.8 };
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let truth: Vec<f32> = (0..SIDE * SIDE).map(|i| 4.0 * albedo(i % SIDE)).collect();
        let mut color: Vec<[f32; 4]> = truth
            .iter()
            .map(|value| {
                [
                    value * 2.0 * random(),
                    value * 2.0 * random(),
                    value * 2.0 * random(),
                    7.0,
                ]
            })
            .collect();
        let guide = |i: u32| [albedo(i % SIDE), albedo(i % SIDE), albedo(i % SIDE), 1.0];
        let guides = [
            (0..SIDE * SIDE).map(guide).collect(),
            vec![[0.0, 0.0, 1.0, 0.0]; (SIDE * SIDE) as usize],
        ];
        let rmse = |color: &[[f32; 4]]| {
            let squares = color
                .iter()
                .zip(&truth)
                .map(|(c, t)| ((c[0] - t) / t).powi(2));
            (squares.sum::<f32>() / truth.len() as f32).sqrt()
        };
        let before = rmse(&color);
        denoiser
            .denoise([SIDE, SIDE], &mut color, &guides)
            .expect("denoises");
        let after = rmse(&color);
        assert!(before > 0.5 && after < 0.1, "{before} -> {after}");
        assert!(color.iter().all(|texel| texel[3] == 7.0));
    }
}
