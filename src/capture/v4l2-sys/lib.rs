//! The kernel's V4L2 interface as Rust sees it: of `linux/videodev2.h` (Linux 6.1) what `v4l` names and we use.
//!
//! The interface is stable: a newer kernel adds, it does not change. `tests.rs` holds sizes and offsets as bindgen asserted them;
//! they are those of every target where a C `long` has 64 bits (x86-64, AArch64, riscv64), and a build for another target stops.
//!
//! `bindings.rs` is taken from the output of bindgen 0.72 with libclang 14:
//!
//! ```text
//! bindgen::Builder::default()
//!     .header_contents("v4l2.h", "#include <linux/videodev2.h>")
//!     .allowlist_type("v4l2_.*|timeval|timespec|time_t|__u.*|__s.*|__le.*")
//!     .allowlist_var("V4L2_.*|VIDIOC_.*|VIDEO_.*")
//!     .generate()?
//!     .write_to_file("bindings.rs")?;
//! ```
//!
//! Kept are the structures whose members are read or written, the constants that are named, and of unions the members of kept
//! types. To add one, generate anew and copy it with its layout's numbers.
#![allow(
    clippy::all,
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals
)]

#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
compile_error!(
    "these V4L2 bindings are for Linux on a 64-bit processor: generate them anew for this target as the crate's documentation says"
);

include!("bindings.rs");

/// Structures of which only size and alignment count: they stand inside others, or `v4l` computes the number of a request from
/// them that nobody here sends.
macro_rules! sized {
    ($($name:ident: [$unit:ty; $count:literal])*) => {
        $(
            #[repr(C)]
            #[derive(Debug, Copy, Clone)]
            pub struct $name([$unit; $count]);
        )*
    };
}

sized! {
    v4l2_timecode: [u32; 4]
    v4l2_window: [u64; 7]
    v4l2_audio: [u32; 13]
    v4l2_audioout: [u32; 13]
    v4l2_crop: [u32; 5]
    v4l2_cropcap: [u32; 11]
    v4l2_edid: [u64; 5]
    v4l2_enc_idx: [u64; 259]
    v4l2_encoder_cmd: [u32; 10]
    v4l2_exportbuffer: [u32; 16]
    v4l2_framebuffer: [u64; 6]
    v4l2_frequency: [u32; 11]
    v4l2_input: [u64; 10]
    v4l2_jpegcompression: [u32; 35]
    v4l2_modulator: [u32; 17]
    v4l2_output: [u64; 9]
    v4l2_queryctrl: [u32; 17]
    v4l2_sliced_vbi_cap: [u32; 29]
    v4l2_standard: [u64; 9]
    v4l2_tuner: [u32; 21]
}

#[cfg(test)]
mod tests;
