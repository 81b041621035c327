//! The whole way from a grey frame to its profile.

use super::banding::{self, Banding};
use super::coarse::{self, BLOCK_ROWS, CoarseScratch, Spots, Tile};
use super::fit::Fit;
use super::haze::{Haze, HazeTable};
use super::kernel::KernelTable;
use super::path::PathScratch;
use super::{ExtractorConfig, Orientation, Profile, ProfileFault, noise, scatter, transpose};
use hydroline_core::frame::GreyView;
use std::ops::Range;

/// Fewest rows in which a stripe and its background fit.
const MIN_ROWS: usize = 16;

/// Extracts stripes, one frame at a time, on the caller's thread. Keeps scratch memory between
/// frames and nothing that changes a result.
#[derive(Debug, Clone)]
pub struct Extractor {
    pub(super) config: ExtractorConfig,
    pub(super) kernels: KernelTable,
    pub(super) haze: HazeTable,
    pub(super) coarse: CoarseScratch,
    pub(super) spots: Spots,
    pub(super) path: PathScratch,
    /// Level from which this frame's pixels are clipped \[grey levels\].
    pub(super) ceiling: u8,
    /// Standard deviation of the rows' common levels \[grey levels\].
    pub(super) row_level_sd: f64,
    pub(super) tracks: Vec<Track>,
    pub(super) stretches: Vec<Range<usize>>,
    /// Width and height pooled over each column's neighbours.
    pub(super) pooled_shape: Vec<[f64; 2]>,
    pub(super) shape_sums: Vec<([f64; 2], f64)>,
    /// Variance pooled over them: at first, and without columns far noisier than that.
    pub(super) first_variance: Vec<[f64; 1]>,
    pub(super) pooled_variance: Vec<[f64; 1]>,
    pub(super) variance_sums: Vec<([f64; 1], f64)>,
    pub(super) order: Vec<f64>,
}

/// One column on its way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track {
    pub column: usize,
    pub spot: usize,
    pub fit: Fit,
    pub near_step: bool,
}

impl Extractor {
    /// An extractor with these settings.
    pub fn new(config: ExtractorConfig) -> Self {
        Self {
            config,
            kernels: KernelTable::new(),
            haze: HazeTable::new(),
            coarse: CoarseScratch::default(),
            spots: Spots::default(),
            path: PathScratch::default(),
            ceiling: u8::MAX,
            row_level_sd: 0.0,
            tracks: Vec::new(),
            stretches: Vec::new(),
            pooled_shape: Vec::new(),
            shape_sums: Vec::new(),
            first_variance: Vec::new(),
            pooled_variance: Vec::new(),
            variance_sums: Vec::new(),
            order: Vec::new(),
        }
    }

    /// The settings.
    pub fn config(&self) -> &ExtractorConfig {
        &self.config
    }

    /// Extracts the stripe of a frame.
    pub fn extract<'a>(&mut self, image: impl Into<GreyView<'a>>) -> Profile {
        let image = image.into();
        if let Some(fault) = self.check(image) {
            return faulty(image, fault);
        }
        match self.config.orientation {
            Orientation::Horizontal => self.extract_lying(image),
            Orientation::Vertical => {
                let lying = transpose::image(image);
                transpose::profile(self.extract_lying((&lying).into()))
            }
        }
    }

    fn check(&self, image: GreyView<'_>) -> Option<ProfileFault> {
        let (width_px, height_px) = (image.width_px, image.height_px);
        let needed = width_px.saturating_mul(height_px);
        let got = image.pixels.len();
        if needed != got {
            return Some(ProfileFault::Malformed {
                width_px,
                height_px,
                needed,
                got,
            });
        }
        let (mut min_columns, mut min_rows) = (self.config.min_columns.max(1), MIN_ROWS);
        if self.config.orientation == Orientation::Vertical {
            (min_columns, min_rows) = (min_rows, min_columns);
        }
        (width_px < min_columns || height_px < min_rows).then_some(ProfileFault::TooSmall {
            width_px,
            height_px,
            min_columns,
            min_rows,
        })
    }

    fn extract_lying(&mut self, image: GreyView<'_>) -> Profile {
        let noise_sd = noise::noise_sd(image);
        let spotted = self.find_spots(image, noise_sd);
        if spotted == 0 {
            let sum: u64 = image.pixels.iter().map(|p| u64::from(*p)).sum();
            let mean_level = sum as f64 / image.pixels.len().max(1) as f64;
            return Profile {
                noise_sd,
                ..faulty(
                    image,
                    ProfileFault::Dark {
                        noise_sd,
                        mean_level,
                    },
                )
            };
        }
        let (mut haze, restless) = self.follow(image, noise_sd);
        self.row_level_sd = 0.0;
        let mut levelled = None;
        if restless && let Some(banding) = self.find_banding(image, haze, noise_sd) {
            let image = banding.taken_off(image, self.ceiling);
            self.find_spots((&image).into(), noise_sd);
            (haze, _) = self.follow((&image).into(), noise_sd);
            self.row_level_sd = banding.left_sd;
            levelled = Some(image);
        }
        let image = levelled.as_ref().map_or(image, GreyView::from);
        let mut profile = Profile {
            noise_sd,
            size_px: (image.width_px, image.height_px),
            ..Default::default()
        };
        if let Some(haze) = haze {
            profile.haze_level = haze.fraction;
            profile.haze_length_px = haze.length_px;
        }
        self.report(image, haze, &mut profile);
        let variance = self.typical_variance();
        if let Some(scale) = scatter::sd_scale(image, &profile.points, noise_sd, variance) {
            for point in profile.points.iter_mut().chain(&mut profile.candidates) {
                point.sd_px *= scale;
            }
        }
        let found = profile.points.len();
        if found < self.config.min_columns.max(1) {
            profile.points.clear();
            profile.fault = Some(ProfileFault::TooFewColumns {
                spotted,
                found,
                needed: self.config.min_columns,
            });
        }
        profile
    }

    /// Median of what the fits leave \[grey levels²\].
    fn typical_variance(&mut self) -> f64 {
        self.order.clear();
        self.order
            .extend(self.tracks.iter().step_by(4).map(|t| t.fit.variance));
        let middle = self.order.len() / 2;
        if self.order.is_empty() {
            return 0.0;
        }
        *self.order.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    fn find_banding(
        &self,
        image: GreyView<'_>,
        haze: Option<Haze>,
        noise_sd: f64,
    ) -> Option<Banding> {
        let widths = self.pooled_shape.iter().map(|s| s[0]);
        let sigma_px = widths.fold(0.0, f64::max);
        banding::find(image, &self.tracks, sigma_px, haze, noise_sd)
    }

    /// Candidates of all columns; returns the number of columns that have one.
    fn find_spots(&mut self, image: GreyView<'_>, noise_sd: f64) -> usize {
        let threshold = coarse::threshold(noise_sd);
        self.spots.clear(image.width_px);
        let tile = Tile {
            from: 0,
            to: image.width_px,
            first: 0,
            last: image.height_px / BLOCK_ROWS - 1,
        };
        coarse::search(image, tile, threshold, &mut self.coarse, &mut self.spots);
        (0..image.width_px)
            .filter(|c| !self.spots.column(*c).is_empty())
            .count()
    }
}

fn faulty(image: GreyView<'_>, fault: ProfileFault) -> Profile {
    Profile {
        size_px: (image.width_px, image.height_px),
        fault: Some(fault),
        ..Default::default()
    }
}
