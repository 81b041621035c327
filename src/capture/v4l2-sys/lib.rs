//! The kernel's V4L2 interface as Rust sees it: `linux/videodev2.h` of Linux 6.1, through bindgen 0.72.
//!
//! The interface is stable: a newer kernel adds, it does not change. Sizes and offsets are asserted at compile time for
//! the target at hand; they hold wherever a C `long` has 64 bits (x86-64, AArch64, riscv64), and a build for another
//! target stops there. To generate anew, with libclang installed, in a scratch crate that depends on `bindgen = "0.72"`:
//!
//! ```text
//! bindgen::Builder::default()
//!     .header_contents("v4l2.h", "#include <linux/videodev2.h>")
//!     .allowlist_type("v4l2_.*|timeval|timespec|time_t|__u.*|__s.*|__le.*")
//!     .allowlist_var("V4L2_.*|VIDIOC_.*|VIDEO_.*")
//!     .generate()?
//!     .write_to_file("bindings.rs")?;
//! ```
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
