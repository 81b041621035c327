//! Cameras that others calibrated: OpenCV's YAML, ROS `camera_info`, Kalibr's camchain, MATLAB's JSON.
//!
//! All four are flat lists of numbers under well-known names, and OpenCV's is no YAML that a parser of YAML takes; so the
//! names are looked for, and the numbers in the brackets or the lines with dashes after them. Pixel coordinates count
//! from the middle of the first pixel as 0, in MATLAB as 1.

use super::camera::{ASPECT, CENTRE, FOCAL, LENS};
use super::{CameraPrior, Known};
use crate::plane::ImageSize;

/// Intrinsics as a file has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Program that the file's names are of.
    pub source: &'static str,
    /// Focal lengths along columns and rows \[px\].
    pub focal_px: [f64; 2],
    /// Principal point \[px\].
    pub centre_px: [f64; 2],
    /// k₁, k₂, p₁, p₂, k₃.
    pub lens: [f64; 5],
    /// Size of the images, where the file says it.
    pub image: Option<ImageSize>,
}

/// Why a file gives no camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum IntrinsicsError {
    #[error(
        "no camera in it: none of camera_matrix (OpenCV, ROS), intrinsics (Kalibr), FocalLength or K (MATLAB) has its numbers; of MATLAB write jsonencode(toStruct(cameraParams)) to a file, a .mat is not read"
    )]
    NoCamera,
    #[error("{key} has {found} numbers, {wanted} are needed")]
    Numbers {
        key: &'static str,
        found: usize,
        wanted: &'static str,
    },
    #[error(
        "its lens is of the model '{model}'; the polynomial of Brown is read (plumb_bob, radtan, rational_polynomial with no more than five numbers)"
    )]
    Model { model: String },
    #[error("{key} is {value}, which no camera has")]
    Absurd { key: &'static str, value: f64 },
    #[error(
        "it is of images of {} x {} px, these have {} x {}; another size or crop is another camera",
        file.width_px, file.height_px, images.width_px, images.height_px
    )]
    Size { file: ImageSize, images: ImageSize },
}

/// Numbers after a name, in brackets or as a list of dashes; `None` where the name is not there.
fn numbers(text: &str, name: &str) -> Option<Vec<f64>> {
    let after = after(text, name)?;
    let next = after.trim_start_matches(['"', '\'', ':', ' ', '\t']);
    // OpenCV and ROS: the numbers are under `data` of the name.
    let data = ["data:", "data :"]
        .iter()
        .filter_map(|d| next.find(d).map(|at| at + d.len()))
        .min();
    let bracket = next.find('[');
    let from = match (data, bracket) {
        (Some(data), Some(open)) if data < open || next.starts_with(['!', '\n', '\r']) => data,
        _ => 0,
    };
    let rest = &next[from..];
    let dashes: Vec<f64> = rest
        .lines()
        .skip_while(|l| l.trim().is_empty())
        .map_while(|l| l.trim().strip_prefix("- ")?.trim().parse().ok())
        .collect();
    if !dashes.is_empty() {
        return Some(dashes);
    }
    let open = rest.find('[')?;
    let (mut depth, mut end) = (0, rest.len());
    for (k, c) in rest[open..].char_indices() {
        depth += match c {
            '[' => 1,
            ']' => -1,
            _ => 0,
        };
        if depth == 0 {
            end = open + k;
            break;
        }
    }
    let words = rest[open..end].split(['[', ']', ',', ' ', '\n', '\r', '\t']);
    words
        .filter(|w| !w.is_empty())
        .map(|w| w.parse().ok())
        .collect()
}

/// Text after a name that begins a line or is in quotes.
fn after<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    text.match_indices(name).find_map(|(at, _)| {
        let before = text[..at].chars().next_back();
        let rest = &text[at + name.len()..];
        let starts = before.is_none_or(|c| matches!(c, '\n' | ' ' | '\t' | '"' | '\'' | '{' | ','));
        let ends = rest
            .trim_start_matches(['"', '\''])
            .trim_start()
            .starts_with(':');
        (starts && ends).then_some(rest)
    })
}

fn word<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let line = after(text, name)?.lines().next()?;
    Some(line.trim_matches(|c: char| !c.is_alphanumeric() && c != '_' && c != '-'))
}

fn whole(text: &str, names: [&str; 2]) -> Option<ImageSize> {
    let [width, height] = names.map(|n| word(text, n)?.parse::<u32>().ok());
    Some(ImageSize {
        width_px: width?,
        height_px: height?,
    })
}

impl Intrinsics {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`IntrinsicsError`].
    pub fn parse(text: &str) -> Result<Self, IntrinsicsError> {
        let model = ["distortion_model", "camera_model"]
            .iter()
            .filter_map(|n| word(text, n));
        let known = ["plumb_bob", "radtan", "pinhole", "rational_polynomial"];
        if let Some(model) = model.into_iter().find(|m| !known.contains(m)) {
            return Err(IntrinsicsError::Model {
                model: model.to_owned(),
            });
        }
        let found = Self::matrix(text)
            .or_else(|| Self::kalibr(text))
            .or_else(|| Self::matlab(text));
        found.ok_or(IntrinsicsError::NoCamera)??.checked()
    }

    fn matrix(text: &str) -> Option<Result<Self, IntrinsicsError>> {
        let names = ["camera_matrix", "Camera_Matrix", "cameraMatrix"];
        let m = names.iter().find_map(|n| numbers(text, n))?;
        if m.len() != 9 {
            return Some(Err(IntrinsicsError::Numbers {
                key: "camera_matrix",
                found: m.len(),
                wanted: "9",
            }));
        }
        let names = [
            "distortion_coefficients",
            "Distortion_Coefficients",
            "distCoeffs",
        ];
        let d = names
            .iter()
            .find_map(|n| numbers(text, n))
            .unwrap_or_default();
        Some(brown(&d).map(|lens| Intrinsics {
            source: "OpenCV or ROS",
            focal_px: [m[0], m[4]],
            centre_px: [m[2], m[5]],
            lens,
            image: whole(text, ["image_width", "image_height"]),
        }))
    }

    fn kalibr(text: &str) -> Option<Result<Self, IntrinsicsError>> {
        let m = numbers(text, "intrinsics")?;
        let [fx, fy, cx, cy] = m[..] else {
            return Some(Err(IntrinsicsError::Numbers {
                key: "intrinsics",
                found: m.len(),
                wanted: "4",
            }));
        };
        let d = numbers(text, "distortion_coeffs").unwrap_or_default();
        let size = numbers(text, "resolution").filter(|r| r.len() == 2);
        Some(brown(&d).map(|lens| Intrinsics {
            source: "Kalibr",
            focal_px: [fx, fy],
            centre_px: [cx, cy],
            lens,
            image: size.map(|r| ImageSize {
                width_px: r[0] as u32,
                height_px: r[1] as u32,
            }),
        }))
    }

    fn matlab(text: &str) -> Option<Result<Self, IntrinsicsError>> {
        let pair = |name| numbers(text, name).filter(|n| n.len() == 2);
        let k = || numbers(text, "K").filter(|n| n.len() == 9);
        // IntrinsicMatrix is the transpose, for rows of points.
        let turned = || numbers(text, "IntrinsicMatrix").filter(|n| n.len() == 9);
        let (focal, centre) = (pair("FocalLength").zip(pair("PrincipalPoint")))
            .or_else(|| k().map(|k| (vec![k[0], k[4]], vec![k[2], k[5]])))
            .or_else(|| turned().map(|k| (vec![k[0], k[4]], vec![k[6], k[7]])))?;
        let radial = numbers(text, "RadialDistortion").unwrap_or_default();
        let tangential = numbers(text, "TangentialDistortion").unwrap_or_default();
        let at = |list: &[f64], k: usize| list.get(k).copied().unwrap_or(0.0);
        Some(Ok(Intrinsics {
            source: "MATLAB",
            focal_px: [focal[0], focal[1]],
            centre_px: [centre[0] - 1.0, centre[1] - 1.0],
            lens: [
                at(&radial, 0),
                at(&radial, 1),
                at(&tangential, 0),
                at(&tangential, 1),
                at(&radial, 2),
            ],
            image: pair("ImageSize").map(|s| ImageSize {
                width_px: s[1] as u32,
                height_px: s[0] as u32,
            }),
        }))
    }

    fn checked(self) -> Result<Self, IntrinsicsError> {
        let absurd = |key, value: f64, sound: bool| match sound && value.is_finite() {
            true => Ok(()),
            false => Err(IntrinsicsError::Absurd { key, value }),
        };
        for f in self.focal_px {
            absurd("the focal length", f, (10.0..1e6).contains(&f))?;
        }
        for c in self.centre_px {
            absurd("the principal point", c, c.abs() < 1e5)?;
        }
        for k in self.lens {
            absurd("a number of the lens", k, k.abs() < 100.0)?;
        }
        Ok(self)
    }

    /// The prior that it makes of a camera whose images have that size.
    ///
    /// # Errors
    /// [`IntrinsicsError::Size`].
    pub fn over(
        &self,
        prior: CameraPrior,
        images: ImageSize,
    ) -> Result<CameraPrior, IntrinsicsError> {
        if let Some(file) = self.image.filter(|file| *file != images) {
            return Err(IntrinsicsError::Size { file, images });
        }
        let mut prior = prior;
        let width = f64::from(images.width_px);
        let [fx, fy] = self.focal_px;
        prior.numbers[FOCAL] = Known::new(fx, FOCAL_SD * fx);
        prior.numbers[ASPECT] = Known::new(fy / fx, ASPECT_SD);
        for (k, centre) in self.centre_px.into_iter().enumerate() {
            prior.numbers[CENTRE + k] = Known::new(centre, CENTRE_SD * width);
        }
        for (k, (value, sd)) in self.lens.into_iter().zip(LENS_SD).enumerate() {
            prior.numbers[LENS + k] = Known::new(value, sd);
        }
        prior.imported = true;
        Ok(prior)
    }
}

/// Sds of intrinsics from a file, which has none: what two careful calibrations of one camera differ by (Zhang 2000,
/// table 1: 0.1 % of the focal length, 1 px of the principal point; a lens focused anew some times that).
const FOCAL_SD: f64 = 0.003;
const ASPECT_SD: f64 = 0.001;
/// As a share of the width.
const CENTRE_SD: f64 = 0.003;
const LENS_SD: [f64; 5] = [0.01, 0.05, 0.001, 0.001, 0.1];

fn brown(d: &[f64]) -> Result<[f64; 5], IntrinsicsError> {
    let more = d.iter().skip(5).any(|v| *v != 0.0);
    if more || !matches!(d.len(), 0 | 4 | 5 | 8 | 12 | 14) {
        return Err(IntrinsicsError::Numbers {
            key: "the distortion",
            found: d.len(),
            wanted: "4 or 5 (k1 k2 p1 p2 k3)",
        });
    }
    Ok(std::array::from_fn(|k| d.get(k).copied().unwrap_or(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Option<ImageSize> = Some(ImageSize {
        width_px: 640,
        height_px: 480,
    });

    fn same(text: &str, source: &str) {
        let read = Intrinsics::parse(text).unwrap();
        assert_eq!(read.source, source);
        assert_eq!(read.focal_px, [536.5, 537.25]);
        assert_eq!(read.centre_px, [342.5, 235.75]);
        assert_eq!(read.lens, [-0.25, 0.125, 0.001, -0.002, 0.5]);
        assert_eq!(read.image, SIZE);
    }

    #[test]
    fn four_programs_say_the_same_camera() {
        same(
            "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 536.5, 0., 342.5, 0.,\n       537.25, 235.75, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -2.5e-01, 0.125, 0.001, -0.002, 0.5 ]\n",
            "OpenCV or ROS",
        );
        same(
            "image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [536.5, 0, 342.5, 0, 537.25, 235.75, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.25, 0.125, 0.001, -0.002, 0.5]\nrectification_matrix:\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n",
            "OpenCV or ROS",
        );
        same(
            "{\"K\":[[536.5,0,343.5],[0,537.25,236.75],[0,0,1]],\"RadialDistortion\":[-0.25,0.125,0.5],\"TangentialDistortion\":[0.001,-0.002],\"ImageSize\":[480,640]}",
            "MATLAB",
        );
        let kalibr = Intrinsics::parse(
            "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.25, 0.125, 0.001, -0.002]\n  distortion_model: radtan\n  intrinsics: [536.5, 537.25, 342.5, 235.75]\n  resolution: [640, 480]\n",
        )
        .unwrap();
        assert_eq!((kalibr.source, kalibr.image), ("Kalibr", SIZE));
        assert_eq!(kalibr.lens, [-0.25, 0.125, 0.001, -0.002, 0.0]);
    }

    #[test]
    fn what_is_no_such_camera_is_said() {
        assert_eq!(Intrinsics::parse("a: 1"), Err(IntrinsicsError::NoCamera));
        let fisheye = Intrinsics::parse("distortion_model: equidistant\nintrinsics: [1, 1, 1, 1]");
        assert!(matches!(fisheye, Err(IntrinsicsError::Model { .. })));
        let few = Intrinsics::parse("camera_matrix: [1, 2, 3]");
        assert!(matches!(
            few,
            Err(IntrinsicsError::Numbers { found: 3, .. })
        ));
        let none = Intrinsics::parse("intrinsics: [0, 500, 320, 240]");
        assert!(matches!(none, Err(IntrinsicsError::Absurd { .. })));
    }
}
