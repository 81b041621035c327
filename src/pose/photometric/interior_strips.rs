//! Strips that no edge cuts: most of the pixels, and only z, φ, θ and the light move them.
//!
//! Along the rows of a strip ds/d(z, φ, θ) and S² are straight to 1e-4 (their curvature is the square of
//! the share that a stripe's width has of the focal length), so a pixel needs one division and one
//! exponential, and its derivatives are sums of five functions that all parameters share.

use super::across::{ACROSS, Across};
use super::lanes::Lanes;
use super::plan::Strip;
use super::pose_geometry::{PoseGeometry, Ray, dot};
use super::sums::{Counter, INTERIOR, RunParameters};
use super::{OF_RUN, Photometric, State};
use crate::normal::Tables;

/// Of a strip's pixels: d light/ds, the same times the row, brightness, thickness, background.
const FRAME: usize = 5;

/// Quantities that are straight over a strip, at one of its ends: S², 1/S, ds/d(z, φ, θ).
struct End {
    total2: f64,
    inverse: f64,
    ds: [f64; 3],
}

/// A strip that no edge cuts, with what it is compared with.
pub(super) struct InteriorStrip<'a> {
    pub geometry: &'a PoseGeometry,
    pub strip: &'a Strip,
    pub pixels: &'a [u8],
    pub state: &'a State,
    pub derivatives: bool,
}

impl Photometric {
    fn end(&self, geometry: &PoseGeometry, strip: &Strip, row: usize, sigma_m: f64) -> Option<End> {
        let [y, z] = self.table.sight(strip.column, row);
        let ray = Ray {
            sight: [self.table.lever_m, y, z],
            slopes: self.table.slopes(strip.column, row),
        };
        let hit = self.hit(geometry, &ray, self.height(strip.level))?;
        let lever = self.table.lever_m;
        let [a, b] = hit.t_slope.map(|t| lever * t);
        let total2 = sigma_m * sigma_m + self.spread_px2 * (a * a + b * b);
        Some(End {
            total2,
            inverse: 1.0 / total2.sqrt(),
            ds: hit.dt.map(|d| lever * d),
        })
    }

    /// Adds a strip that no edge cuts to the sums.
    pub(super) fn compare_interior(&self, all: InteriorStrip<'_>, counter: &mut Counter<'_>) {
        match counter.run_parameters() {
            RunParameters::Known => self.compare_interior_by::<FRAME, FRAME>(all, counter),
            RunParameters::Considered => {
                self.compare_interior_by::<{ FRAME + OF_RUN }, FRAME>(all, counter)
            }
            RunParameters::Estimated => {
                self.compare_interior_by::<{ FRAME + OF_RUN }, { FRAME + OF_RUN }>(all, counter)
            }
        }
    }

    /// The same with so many of [`FRAME`] and the run's parameters; of those after the first OWN no products with each other.
    #[inline]
    fn compare_interior_by<const N: usize, const OWN: usize>(
        &self,
        all: InteriorStrip<'_>,
        counter: &mut Counter<'_>,
    ) {
        let InteriorStrip {
            geometry,
            strip,
            pixels,
            state,
            derivatives,
        } = all;
        let Some([first, last]) =
            self.table
                .sound_rows(strip.column, strip.first_row, strip.end_row)
        else {
            return;
        };
        let sigma = state.thickness_m;
        let (Some(a), Some(b)) = (
            self.end(geometry, strip, first, sigma),
            self.end(geometry, strip, last, sigma),
        ) else {
            return;
        };
        let tables = Tables::get();
        let width = self.table.width_px;
        let middle = 0.5 * (last - first) as f64;
        let per_row = 1.0 / (last - first).max(1) as f64;
        let line = |a: f64, b: f64| (0.5 * (a + b), (b - a) * per_row);
        let (total2, total2_slope) = line(a.total2, b.total2);
        let full = self.albedo(strip.level) * sigma;
        let (height, height_slope) = line(full * a.inverse, full * b.inverse);
        let lever = self.table.lever_m;
        let r3 = &geometry.r[2];
        let ahead = r3[0] * lever;
        let eye = self.table.eye_m;
        let over =
            -self.height(strip.level) - geometry.position[2] - dot(r3, &[eye.x, eye.y, eye.z]);
        let of_sigma = 1.0 / sigma;
        let across = Across::new(&state.across, sigma);
        let faded = across.faded(1.0 / total2);
        // Sums of products of: d light/ds, the same times the row, d/d brightness, d/d thickness, 1, d/d tone, d/d black, and
        // by the coefficients of the line's transverse profile.
        let mut products = [[0.0; N]; N];
        let mut right = [0.0; N];
        let mut waiting = Lanes::<N>::new();
        let mut tally = counter.sums.tally;
        let sights = self.table.sights(strip.column, first, last + 1);
        let mut at = first * width + strip.column;
        for (k, [y, z]) in sights.iter().enumerate() {
            let Some(&grey) = pixels.get(at) else {
                break;
            };
            at += width;
            let u = k as f64 - middle;
            let down = ahead + r3[1] * y + r3[2] * z;
            let seen = down > 0.0;
            if !seen {
                continue;
            }
            let total2 = total2 + total2_slope * u;
            let both = 1.0 / (down * total2);
            let of_total2 = both * down;
            let s = lever * (over - down) * (both * total2);
            let off = s * s * of_total2;
            let round = tables.exp(0.5 * off) * (height + height_slope * u);
            let mut by_terms = [0.0; ACROSS];
            let line = if N > FRAME {
                across.at_by(s, of_total2, &mut by_terms)
            } else {
                faded.at(s, of_total2)
            };
            let bare = round * line.light;
            let light = state.brightness * bare;
            let background = counter.background(state.background, first + k);
            let judged = if N > FRAME {
                counter.interior::<true>(grey, light, background, &mut tally)
            } else {
                counter.interior::<false>(grey, light, background, &mut tally)
            };
            let Some(judged) = judged.filter(|_| derivatives) else {
                continue;
            };
            let of_line = state.brightness * round * judged.share;
            let by_s = of_line * line.slope - light * s * of_total2 * judged.share;
            let mut j = [0.0; N];
            [j[0], j[1]] = [by_s, by_s * u];
            j[2] = bare * judged.share;
            j[3] = light * (of_sigma - sigma * of_total2 * (1.0 - off)) * judged.share
                + of_line * line.by_sigma;
            j[4] = judged.share;
            if N > FRAME {
                let by_run = counter.by_run(judged.by_camera, &by_terms.map(|by| of_line * by));
                for (j, by) in j[FRAME..].iter_mut().zip(by_run) {
                    *j = by;
                }
            }
            if OWN == FRAME + OF_RUN {
                let x = s * of_total2.sqrt();
                counter
                    .sums
                    .line_residuals
                    .see(x, judged.weight, judged.residual);
            }
            if waiting.push(&j, judged.weight, judged.residual) {
                waiting.empty_first_into::<N, OWN>(&mut products, &mut right);
            }
        }
        counter.sums.tally = tally;
        if !derivatives {
            return;
        }
        waiting.empty_first_into::<N, OWN>(&mut products, &mut right);
        // Of each pose parameter: ds in the middle, and what it gains per row.
        let pose: [(f64, f64); 3] = std::array::from_fn(|k| line(a.ds[k], b.ds[k]));
        for (n, &(m, g)) in pose.iter().enumerate() {
            let row = &mut counter.information[INTERIOR[n]];
            for (k, &(mk, gk)) in pose[..=n].iter().enumerate() {
                row[INTERIOR[k]] += m * mk * products[0][0]
                    + (m * gk + g * mk) * products[1][0]
                    + g * gk * products[1][1];
            }
            counter.gradient[INTERIOR[n]] += m * right[0] + g * right[1];
            for light in 2..N {
                counter.information[INTERIOR[light + 1]][INTERIOR[n]] +=
                    m * products[light][0] + g * products[light][1];
            }
        }
        for a in 2..N {
            counter.gradient[INTERIOR[a + 1]] += right[a];
            for b in 2..=a {
                counter.information[INTERIOR[a + 1]][INTERIOR[b + 1]] += products[a][b];
            }
        }
    }
}
