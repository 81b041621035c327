//! `[laser]`, `[mounts]` and `[port]` as typed.

use super::{Section, quantity};
use crate::{Channel, FlatPort, Laser, Mounts, PixelFormat};

/// `format` = the camera's: a channel needs a colour camera.
pub(super) fn read_laser(s: &Section<'_>, format: Option<PixelFormat>) -> Option<Laser> {
    let fan_rad = s.angle("fan", quantity(1.0, 170.0, "deg"));
    let sigma_m = s.number(
        "sigma_m",
        quantity(1e-5, 0.05, "m").hint("A Gaussian sheet's full width is about 3 sigma"),
    );
    let peak = s.number("peak", quantity(1.0, 10_000.0, "grey levels"));
    let shadows = s.flag_or("shadows", false);
    let vertical = s.choice_opt("orientation", &[("horizontal", false), ("vertical", true)]);
    if vertical == Some(true) {
        s.rule(
            "orientation",
            "calibration and poses know a line that runs along the image's rows (\"horizontal\") only",
            "Turn the camera by 90 degrees; single images go through `hydroline extract --orientation vertical`",
        );
    }
    let channel = match s.has("channel") {
        true => s.choice_opt("channel", &Channel::ALL),
        false => {
            s.item("channel");
            Some(Channel::Luma)
        }
    };
    s.default_is("channel", Channel::Luma.name());
    s.default_is("orientation", "horizontal");
    if let (Some(channel), Some(format)) = (channel, format)
        && channel != Channel::Luma
        && !format.has_colour()
    {
        s.rule(
            "channel",
            format!(
                "the {} channel of a camera without colours: camera.pixel_format = \"{}\" is grey",
                channel.name(),
                format.name()
            ),
            "Leave out `channel`, or choose a colour format as camera.pixel_format",
        );
    }
    s.finish();
    Some(Laser {
        fan_rad: fan_rad?,
        sigma_m: sigma_m?,
        peak: peak?,
        channel: channel?,
        shadows,
    })
}

pub(super) fn read_mounts(s: &Section<'_>) -> Option<Mounts> {
    let length = quantity(-20.0, 20.0, "m");
    let l_laser_m = s.number("l_laser_m", length);
    let l_camera_m = s.number("l_camera_m", length);
    let h_camera_m = s.number("h_camera_m", length);
    let h_centre_m = s.number("h_centre_m", length);
    let camera_tilt_rad = s.angle(
        "camera_tilt",
        quantity(-89.0, 89.0, "deg").hint("0 looks straight down, positive looks forward"),
    );
    s.finish();
    let mounts = Mounts {
        l_laser_m: l_laser_m?,
        l_camera_m: l_camera_m?,
        h_camera_m: h_camera_m?,
        h_centre_m: h_centre_m?,
        camera_tilt_rad: camera_tilt_rad?,
    };
    let baseline_m = mounts.l_laser_m + mounts.l_camera_m;
    if baseline_m.abs() < 1e-3 {
        s.rule(
            "l_camera_m",
            format!(
                "the camera sits {baseline_m} m from the laser sheet (l_laser_m + l_camera_m): it sees the sheet edge on and cannot measure in it"
            ),
            "Enter the distances of camera (aft) and sheet (forward) from the CG; they must add up to at least 1 mm",
        );
    }
    Some(mounts)
}

/// `Some(None)`: the rig has none. `None`: reported.
pub(super) fn read_port(root: &Section<'_>) -> Option<Option<FlatPort>> {
    if !root.has("port") {
        return Some(None);
    }
    let s = root.table("port");
    let distance_m = s.number(
        "distance_m",
        quantity(0.0, 0.5, "m").hint("From the lens' entrance pupil to the port's inner face"),
    );
    let glass_m = s.number(
        "glass_m",
        quantity(0.0, 0.1, "m").hint("The port's thickness"),
    );
    s.finish();
    Some(Some(FlatPort {
        distance_m: distance_m?,
        glass_m: glass_m?,
    }))
}
