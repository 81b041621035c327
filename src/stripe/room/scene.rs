//! Frames of a real room with known truth: lamps, bars, windows, reflections, banding, a camera's
//! curve and range, JPEG. Made apart from `synthetic`, which renders what the extractor assumes.

use crate::kernel::profile;
use hydroline_core::frame::GreyImage;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, codecs::jpeg::JpegEncoder};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Something in the picture that is no stripe.
#[derive(Debug, Clone, Copy)]
pub(super) enum Thing {
    /// A band of even light over the whole width: first row, rows, levels, softness of its edges.
    Bar {
        first_row: f64,
        rows: f64,
        level: f64,
        edge_px: f64,
    },
    /// A round Gaussian blob.
    Lamp {
        column: f64,
        row: f64,
        sigma_px: f64,
        level: f64,
    },
    /// A bright rectangle with edges of this softness.
    Window {
        columns: (f64, f64),
        rows: (f64, f64),
        level: f64,
        edge_px: f64,
    },
    /// A second thin line over these columns, `offset_px` rows from the stripe at its middle.
    Reflection {
        columns: (f64, f64),
        offset_px: f64,
        slope: f64,
        sigma_px: f64,
        level: f64,
    },
}

/// Ambient light that flickers while the rows are read.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Banding {
    pub level: f64,
    pub period_px: f64,
    pub phase: f64,
    /// Change of phase from the first row to the last, beyond the period \[rad\].
    pub drift: f64,
}

/// A frame.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub width_px: usize,
    pub height_px: usize,
    pub row0_px: f64,
    pub slope: f64,
    /// Amplitude, period and phase of the stripe's course.
    pub undulation: (f64, f64, f64),
    /// From these columns on the stripe lies so much lower \[px\].
    pub steps: Vec<(f64, f64)>,
    pub sigma_px: f64,
    pub peak: f64,
    /// Change of the peak along the columns, as a fraction, one wave per frame.
    pub uneven: f64,
    pub background: f64,
    pub noise_sd: f64,
    pub things: Vec<Thing>,
    pub banding: Banding,
    /// Range of the camera: what 0 and 255 become.
    pub range: (f64, f64),
    pub gamma: f64,
    pub jpeg: Option<u8>,
    pub seed: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            width_px: 720,
            height_px: 576,
            row0_px: 290.3,
            slope: 0.03,
            undulation: (0.0, 300.0, 0.0),
            steps: Vec::new(),
            sigma_px: 2.0,
            peak: 160.0,
            uneven: 0.1,
            background: 14.0,
            noise_sd: 2.0,
            things: Vec::new(),
            banding: Banding::default(),
            range: (0.0, 255.0),
            gamma: 1.0,
            jpeg: None,
            seed: 0,
        }
    }
}

/// Share of an edge `distance_px` behind it, softened (logistic: no Gaussian of ours).
fn behind(distance_px: f64, edge_px: f64) -> f64 {
    1.0 / (1.0
        + (-1.7 * distance_px / edge_px.max(0.05))
            .clamp(-40.0, 40.0)
            .exp())
}

impl Scene {
    /// True row of the stripe \[px\].
    pub fn row_px(&self, column_px: f64) -> f64 {
        let (amplitude, period, phase) = self.undulation;
        let wave = amplitude * (std::f64::consts::TAU * column_px / period + phase).sin();
        let lower: f64 = self
            .steps
            .iter()
            .filter(|s| column_px >= s.0)
            .map(|s| s.1)
            .sum();
        self.row0_px + self.slope * column_px + wave + lower
    }

    fn things_at(&self, column: f64, row: f64) -> f64 {
        let mut light = 0.0;
        for thing in &self.things {
            light += match *thing {
                Thing::Bar {
                    first_row,
                    rows,
                    level,
                    edge_px,
                } => {
                    let upper = behind(row + 0.5 - first_row, edge_px);
                    level * upper * behind(first_row + rows - row - 0.5, edge_px)
                }
                Thing::Lamp {
                    column: c,
                    row: r,
                    sigma_px,
                    level,
                } => {
                    let d2 = (column - c).powi(2) + (row - r).powi(2);
                    level * (-0.5 * d2 / (sigma_px * sigma_px)).exp()
                }
                Thing::Window {
                    columns,
                    rows,
                    level,
                    edge_px,
                } => {
                    level
                        * behind(column - columns.0, edge_px)
                        * behind(columns.1 - column, edge_px)
                        * behind(row - rows.0, edge_px)
                        * behind(rows.1 - row, edge_px)
                }
                Thing::Reflection {
                    columns,
                    offset_px,
                    slope,
                    sigma_px,
                    level,
                } => {
                    let middle = 0.5 * (columns.0 + columns.1);
                    let at = self.row_px(middle) + offset_px + slope * (column - middle);
                    let d = row - at;
                    let inside = column >= columns.0 && column <= columns.1;
                    if inside && d.abs() < 8.0 * sigma_px {
                        level * profile(d, sigma_px)[0]
                    } else {
                        0.0
                    }
                }
            };
        }
        light
    }

    /// The frame and, per column, whether the stripe's light was clipped by the range's maximum.
    pub fn render(&self) -> (GreyImage, Vec<bool>) {
        let mut rng = StdRng::seed_from_u64(self.seed ^ 0x9e37_79b9);
        let (w, h) = (self.width_px, self.height_px);
        let mut pixels = vec![0u8; w * h];
        let mut clipped = vec![false; w];
        let rows: Vec<f64> = (0..w).map(|c| self.row_px(c as f64)).collect();
        let b = self.banding;
        for row in 0..h {
            let at = row as f64;
            let angle = std::f64::consts::TAU * at / b.period_px.max(1.0)
                + b.phase
                + b.drift * at / h as f64;
            let band = b.level * angle.sin();
            for column in 0..w {
                let c = column as f64;
                let d = at - rows[column];
                let mut light = self.background + band;
                let near = d.abs() < 8.0 * self.sigma_px + 1.0;
                if near {
                    let along = 1.0 + self.uneven * (std::f64::consts::TAU * c / w as f64).cos();
                    light += self.peak * along * profile(d, self.sigma_px)[0];
                }
                if !self.things.is_empty() {
                    light += self.things_at(c, at);
                }
                let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
                let normal = (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
                let level = light + self.noise_sd * normal;
                if near && d.abs() < 2.0 * self.sigma_px && level >= 255.0 {
                    clipped[column] = true;
                }
                let toned = (level.clamp(0.0, 255.0) / 255.0).powf(self.gamma);
                let (low, high) = self.range;
                pixels[row * w + column] = (low + (high - low) * toned).round() as u8;
            }
        }
        if let Some(quality) = self.jpeg {
            let mut bytes = Vec::new();
            JpegEncoder::new_with_quality(&mut bytes, quality)
                .write_image(&pixels, w as u32, h as u32, ExtendedColorType::L8)
                .unwrap();
            pixels = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg)
                .unwrap()
                .into_luma8()
                .into_raw();
        }
        let image = GreyImage {
            width_px: w,
            height_px: h,
            pixels,
        };
        (image, clipped)
    }
}
