//! Layouts as bindgen 0.72 asserted them for the kernel's header: bytes and alignment of a structure, offsets of its members.

use super::*;
use std::mem::{align_of, offset_of, size_of};

macro_rules! layouts {
    ($($name:ident: $size:literal, $alignment:literal { $($field:ident = $offset:literal),* })*) => {
        $(
            assert_eq!((size_of::<$name>(), align_of::<$name>()), ($size, $alignment), stringify!($name));
            $(assert_eq!(offset_of!($name, $field), $offset, stringify!($name::$field));)*
        )*
    };
}

#[rustfmt::skip]
#[test]
fn structures_lie_in_memory_as_the_kernel_has_them() {
    layouts! {
        timeval: 16, 8 { tv_sec = 0, tv_usec = 8 }
        v4l2_fract: 8, 4 { numerator = 0, denominator = 4 }
        v4l2_capability: 104, 4 { driver = 0, card = 16, bus_info = 48, version = 80, capabilities = 84, device_caps = 88, reserved = 92 }
        v4l2_pix_format__bindgen_ty_1: 4, 4 { ycbcr_enc = 0, hsv_enc = 0 }
        v4l2_pix_format: 48, 4 { width = 0, height = 4, pixelformat = 8, field = 12, bytesperline = 16, sizeimage = 20, colorspace = 24, priv_ = 28, flags = 32, quantization = 40, xfer_func = 44 }
        v4l2_fmtdesc: 64, 4 { index = 0, type_ = 4, flags = 8, description = 12, pixelformat = 44, mbus_code = 48, reserved = 52 }
        v4l2_frmsize_discrete: 8, 4 { width = 0, height = 4 }
        v4l2_frmsize_stepwise: 24, 4 { min_width = 0, max_width = 4, step_width = 8, min_height = 12, max_height = 16, step_height = 20 }
        v4l2_frmsizeenum__bindgen_ty_1: 24, 4 { discrete = 0, stepwise = 0 }
        v4l2_frmsizeenum: 44, 4 { index = 0, pixel_format = 4, type_ = 8, reserved = 36 }
        v4l2_frmival_stepwise: 24, 4 { min = 0, max = 8, step = 16 }
        v4l2_frmivalenum__bindgen_ty_1: 24, 4 { discrete = 0, stepwise = 0 }
        v4l2_frmivalenum: 52, 4 { index = 0, pixel_format = 4, width = 8, height = 12, type_ = 16, reserved = 44 }
        v4l2_requestbuffers: 20, 4 { count = 0, type_ = 4, memory = 8, capabilities = 12, flags = 16, reserved = 17 }
        v4l2_plane__bindgen_ty_1: 8, 8 { mem_offset = 0, userptr = 0, fd = 0 }
        v4l2_plane: 64, 8 { bytesused = 0, length = 4, m = 8, data_offset = 16, reserved = 20 }
        v4l2_buffer__bindgen_ty_1: 8, 8 { offset = 0, userptr = 0, planes = 0, fd = 0 }
        v4l2_buffer__bindgen_ty_2: 4, 4 { request_fd = 0, reserved = 0 }
        v4l2_buffer: 88, 8 { index = 0, type_ = 4, bytesused = 8, flags = 12, field = 16, timestamp = 24, timecode = 40, sequence = 56, memory = 60, m = 64, length = 72, reserved2 = 76 }
        v4l2_captureparm: 40, 4 { capability = 0, capturemode = 4, timeperframe = 8, extendedmode = 16, readbuffers = 20, reserved = 24 }
        v4l2_outputparm: 40, 4 { capability = 0, outputmode = 4, timeperframe = 8, extendedmode = 16, writebuffers = 20, reserved = 24 }
        v4l2_control: 8, 4 { id = 0, value = 4 }
        v4l2_ext_control__bindgen_ty_1: 8, 8 { value = 0, value64 = 0, string = 0, p_u8 = 0, p_u16 = 0, p_u32 = 0, ptr = 0 }
        v4l2_ext_control: 20, 1 { id = 0, size = 4, reserved2 = 8 }
        v4l2_ext_controls__bindgen_ty_1: 4, 4 { ctrl_class = 0, which = 0 }
        v4l2_ext_controls: 32, 8 { count = 4, error_idx = 8, request_fd = 12, reserved = 16, controls = 24 }
        v4l2_query_ext_ctrl: 232, 8 { id = 0, type_ = 4, name = 8, minimum = 40, maximum = 48, step = 56, default_value = 64, flags = 72, elem_size = 76, elems = 80, nr_of_dims = 84, dims = 88, reserved = 104 }
        v4l2_querymenu__bindgen_ty_1: 32, 8 { name = 0, value = 0 }
        v4l2_querymenu: 44, 1 { id = 0, index = 4, reserved = 40 }
        v4l2_plane_pix_format: 20, 1 { sizeimage = 0, bytesperline = 4, reserved = 8 }
        v4l2_pix_format_mplane__bindgen_ty_1: 1, 1 { ycbcr_enc = 0, hsv_enc = 0 }
        v4l2_pix_format_mplane: 192, 1 { width = 0, height = 4, pixelformat = 8, field = 12, colorspace = 16, plane_fmt = 20, num_planes = 180, flags = 181, quantization = 183, xfer_func = 184, reserved = 185 }
        v4l2_format__bindgen_ty_1: 200, 8 { pix = 0, pix_mp = 0, win = 0, raw_data = 0 }
        v4l2_format: 208, 8 { type_ = 0, fmt = 8 }
        v4l2_streamparm__bindgen_ty_1: 200, 4 { capture = 0, output = 0, raw_data = 0 }
        v4l2_streamparm: 204, 4 { type_ = 0, parm = 4 }
        v4l2_edid: 40, 8 {}
        v4l2_timecode: 16, 4 {}
        v4l2_jpegcompression: 140, 4 {}
        v4l2_exportbuffer: 64, 4 {}
        v4l2_framebuffer: 48, 8 {}
        v4l2_window: 56, 8 {}
        v4l2_cropcap: 44, 4 {}
        v4l2_crop: 20, 4 {}
        v4l2_standard: 72, 8 {}
        v4l2_input: 80, 8 {}
        v4l2_output: 72, 8 {}
        v4l2_queryctrl: 68, 4 {}
        v4l2_tuner: 84, 4 {}
        v4l2_modulator: 68, 4 {}
        v4l2_frequency: 44, 4 {}
        v4l2_audio: 52, 4 {}
        v4l2_audioout: 52, 4 {}
        v4l2_enc_idx: 2072, 8 {}
        v4l2_encoder_cmd: 40, 4 {}
        v4l2_sliced_vbi_cap: 116, 4 {}
    }
}
