//! The image with its nodes drawn in.

use hydroline_calib::Calibration;
use hydroline_calib::board::node_m;
use hydroline_core::frame::GreyImage;
use hydroline_daemon::calibrate::{Setup, see};
use image::{Rgb, RgbImage};

const FOUND: Rgb<u8> = Rgb([0, 220, 0]);
const MISSED: Rgb<u8> = Rgb([255, 40, 40]);
/// Half length of a cross \[px\].
const ARM_PX: i64 = 4;

/// Nodes found as green crosses; nodes of the board that the map places in the image but nobody found, red.
pub fn annotate(setup: &Setup, grey: &GreyImage, calibration: &Calibration) -> RgbImage {
    let mut picture = RgbImage::from_fn(grey.width_px as u32, grey.height_px as u32, |c, r| {
        let v = grey
            .pixels
            .get(r as usize * grey.width_px + c as usize)
            .copied()
            .unwrap_or(0);
        Rgb([v, v, v])
    });
    let found = see(setup, grey, false)
        .map(|s| s.detection.nodes)
        .unwrap_or_default();
    for n in &found {
        cross(&mut picture, n.node.column_px, n.node.row_px, FOUND);
    }
    let map = calibration.map.fitted();
    for j in 0..setup.board.rows {
        for i in 0..setup.board.columns {
            if found.iter().any(|n| (n.i, n.j) == (i, j)) {
                continue;
            }
            let [xi, eta] = node_m(&setup.board, i, j);
            if let Some((column, row)) = map.as_ref().and_then(|m| m.to_image(xi, eta)) {
                cross(&mut picture, column, row, MISSED);
            }
        }
    }
    picture
}

fn cross(picture: &mut RgbImage, column_px: f64, row_px: f64, colour: Rgb<u8>) {
    let (c, r) = (column_px.round() as i64, row_px.round() as i64);
    for d in -ARM_PX..=ARM_PX {
        for (x, y) in [(c + d, r), (c, r + d)] {
            if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
            {
                *pixel = colour;
            }
        }
    }
}
