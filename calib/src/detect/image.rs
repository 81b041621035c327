//! Grey images and the little filtering that detection needs.

/// A borrowed 8-bit grey image, rows from top, no padding.
#[derive(Debug, Clone, Copy)]
pub struct Grey<'a> {
    width: usize,
    height: usize,
    pixels: &'a [u8],
}

impl<'a> Grey<'a> {
    /// Wraps `width × height` pixels; `None` when the slice is not that long.
    pub fn new(width: usize, height: usize, pixels: &'a [u8]) -> Option<Self> {
        (width.checked_mul(height)? == pixels.len()).then_some(Grey {
            width,
            height,
            pixels,
        })
    }

    /// Width \[px\].
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height \[px\].
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels, row by row.
    pub fn pixels(&self) -> &'a [u8] {
        self.pixels
    }

    /// Grey level at a pixel, clamped to the image.
    #[inline]
    pub(crate) fn at(&self, column: i64, row: i64) -> f32 {
        let c = column.clamp(0, self.width as i64 - 1) as usize;
        let r = row.clamp(0, self.height as i64 - 1) as usize;
        f32::from(self.pixels[r * self.width + c])
    }

    /// Linear interpolation.
    pub(super) fn sample(&self, column: f64, row: f64) -> f32 {
        let (c, r) = (column.floor(), row.floor());
        let (fc, fr) = ((column - c) as f32, (row - r) as f32);
        let (c, r) = (c as i64, r as i64);
        (self.at(c, r) * (1.0 - fc) + self.at(c + 1, r) * fc) * (1.0 - fr)
            + (self.at(c, r + 1) * (1.0 - fc) + self.at(c + 1, r + 1) * fc) * fr
    }
}

/// An image of its own.
#[derive(Debug, Clone)]
pub(super) struct Halved {
    pub width: usize,
    pub height: usize,
    pixels: Vec<u8>,
}

impl Halved {
    pub fn grey(&self) -> Grey<'_> {
        Grey {
            width: self.width,
            height: self.height,
            pixels: &self.pixels,
        }
    }
}

impl Grey<'_> {
    /// Means over blocks of 2 × 2; an odd last column or row is left out.
    pub(super) fn halved(&self) -> Halved {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut pixels = Vec::with_capacity(width * height);
        for r in 0..height {
            let line = |k: usize| &self.pixels[(2 * r + k) * self.width..][..2 * width];
            let blocks = line(0).chunks_exact(2).zip(line(1).chunks_exact(2));
            pixels.extend(blocks.map(|(a, b)| {
                let sum: u16 = a.iter().chain(b).map(|v| u16::from(*v)).sum();
                // Halves up and down in turn: up alone would make it lighter.
                ((sum + 1 + (sum >> 2 & 1)) / 4) as u8
            }));
        }
        Halved {
            width,
            height,
            pixels,
        }
    }
}

/// A float plane at some reduction of the image.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
    /// Image pixels per pixel of this plane.
    pub reduction: usize,
    /// Variance of its smoothing \[px² of this plane\].
    pub smoothing: usize,
}

impl Plane {
    /// Means over `reduction` × `reduction` blocks, then a Gaussian of 1 pixel.
    pub fn smoothed(image: &Grey<'_>, reduction: usize) -> Self {
        let (width, height) = (image.width / reduction, image.height / reduction);
        let mut values = vec![0.0f32; width * height];
        if reduction == 1 {
            for (out, &v) in values.iter_mut().zip(image.pixels) {
                *out = f32::from(v);
            }
        } else {
            let share = 1.0 / (reduction * reduction) as f32;
            let mut sums = vec![0u32; width];
            for r in 0..height {
                sums.fill(0);
                for k in 0..reduction {
                    let line = &image.pixels[(r * reduction + k) * image.width..][..image.width];
                    for (sum, block) in sums.iter_mut().zip(line.chunks_exact(reduction)) {
                        *sum += block.iter().map(|&v| u32::from(v)).sum::<u32>();
                    }
                }
                for (out, &sum) in values[r * width..][..width].iter_mut().zip(&sums) {
                    *out = sum as f32 * share;
                }
            }
        }
        let mut plane = Plane {
            width,
            height,
            values,
            reduction,
            smoothing: 1,
        };
        plane.blur();
        plane
    }

    /// The same with a Gaussian of 2 pixels.
    pub fn softer(mut self) -> Self {
        while self.smoothing < 4 {
            self.blur();
            self.smoothing += 1;
        }
        self
    }

    /// Separable Gaussian, σ = 1 (7 taps); borders keep their values.
    fn blur(&mut self) {
        const TAPS: [f32; 4] = [0.399_05, 0.242_04, 0.054_005, 0.004_433_3];
        let (w, h) = (self.width, self.height);
        if w < 8 || h < 8 {
            return;
        }
        let mut across = self.values.clone();
        for (line, out) in self.values.chunks_exact(w).zip(across.chunks_exact_mut(w)) {
            for (window, out) in line.windows(7).zip(&mut out[3..w - 3]) {
                *out = TAPS[0] * window[3]
                    + TAPS[1] * (window[2] + window[4])
                    + TAPS[2] * (window[1] + window[5])
                    + TAPS[3] * (window[0] + window[6]);
            }
        }
        for r in 3..h - 3 {
            let row = |k: usize| &across[(r + k - 3) * w..][..w];
            let rows = [row(0), row(1), row(2), row(3), row(4), row(5), row(6)];
            let out = &mut self.values[r * w..][..w];
            for c in 0..w {
                out[c] = TAPS[0] * rows[3][c]
                    + TAPS[1] * (rows[2][c] + rows[4][c])
                    + TAPS[2] * (rows[1][c] + rows[5][c])
                    + TAPS[3] * (rows[0][c] + rows[6][c]);
            }
        }
    }

    /// Value at image coordinates, nearest pixel.
    #[inline]
    pub fn near(&self, column_px: f64, row_px: f64) -> f32 {
        let k = self.reduction as f64;
        let c = ((column_px + 0.5) / k) as i64;
        let r = ((row_px + 0.5) / k) as i64;
        let c = c.clamp(0, self.width as i64 - 1) as usize;
        let r = r.clamp(0, self.height as i64 - 1) as usize;
        self.values[r * self.width + c]
    }
}
