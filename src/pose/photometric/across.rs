//! The line's transverse profile.
//!
//! A Gaussian, times what makes it skew, flat-topped or winged (Gram and Charlier's series; Kendall and Stuart, chapter 6):
//!
//! light = A (σ/S) e^(−x²/2) q(x),  q(x) = 1 + Σ cₙ κⁿ Heₙ(x),  x = s/S,  κ = σ/S,  n = 3…10
//!
//! with Hermite's polynomials: blur turns such a line into another one of the same kind, of which each term has faded by κⁿ.
//! The first and second terms are the line's place and thickness. Four terms hold lines with a flat top, wings or a side
//! lobe to a hundredth of their peak, where the Gaussian is off by 2 to 13; a camera's curve takes up that hundredth and is
//! then off by many of its sds, so that there are eight. The cₙ are the laser's, the same in all frames
//! of a run. Where an edge cuts the line inside one point spread the tilt of what is left of it is the Gaussian's.

/// Number of terms.
pub(crate) const ACROSS: usize = 8;
/// Order of the first.
const FIRST: usize = 3;

/// Bins across the line, and their width \[S\], in which it is seen what the series leaves.
pub(crate) const BINS: usize = 40;
const BIN: f64 = 0.25;

/// Of each bin: Σ weight × residual, Σ weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineResiduals([[f64; 2]; BINS]);

impl Default for LineResiduals {
    fn default() -> Self {
        LineResiduals([[0.0; 2]; BINS])
    }
}

impl LineResiduals {
    /// A pixel at x = s/S.
    #[inline]
    pub(super) fn see(&mut self, x: f64, weight: f64, residual: f64) {
        let place = x / BIN + 0.5 * BINS as f64;
        if (0.0..BINS as f64).contains(&place) {
            let [sum, weights] = &mut self.0[place as usize];
            *sum += weight * residual;
            *weights += weight;
        }
    }

    /// Those of another frame too.
    pub fn and(mut self, other: &LineResiduals) -> LineResiduals {
        for (own, of) in self.0.iter_mut().zip(&other.0) {
            *own = [own[0] + of[0], own[1] + of[1]];
        }
        self
    }

    /// Mean squared residual of bins in units of their noise, what the fit takes of it given back: one where nothing is left.
    pub fn in_noise(&self) -> f64 {
        let seen = self.0.iter().filter(|[_, weights]| *weights > 0.0);
        let (square, n) = seen.fold((0.0, 0.0), |(square, n), [sum, weights]| {
            (square + sum * sum / weights, n + 1.0)
        });
        // Brightness, place, thickness, background and the series.
        square / (n - (4 + ACROSS) as f64).max(1.0)
    }
}

/// The series of a line of a thickness.
#[derive(Debug, Clone, Copy)]
pub(super) struct Across {
    coefficients: [f64; ACROSS],
    /// Whether there are any.
    gaussian: bool,
    sigma_m: f64,
}

/// Powers of x in the series.
const POWERS: usize = FIRST + ACROSS;

/// Heₙ by powers of x.
const HERMITE: [[f64; POWERS]; POWERS] = {
    let mut he = [[0.0; POWERS]; POWERS];
    (he[0][0], he[1][1]) = (1.0, 1.0);
    let mut n = 2;
    while n < POWERS {
        he[n][0] = -((n - 1) as f64) * he[n - 2][0];
        let mut k = 1;
        while k <= n {
            he[n][k] = he[n - 1][k - 1] - (n - 1) as f64 * he[n - 2][k];
            k += 1;
        }
        n += 1;
    }
    he
};

/// The series where blur fades it by the same: over the rows of a strip κ changes by a thousandth.
pub(super) struct Faded {
    /// q, and κ dq/dκ, by powers of x.
    light: [f64; POWERS],
    by_fading: [f64; POWERS],
    gaussian: bool,
    sigma_m: f64,
}

/// At one place across the line.
#[derive(Debug, Clone, Copy)]
pub(super) struct At {
    /// q, the factor of the Gaussian.
    pub light: f64,
    /// dq/ds \[1/m\].
    pub slope: f64,
    /// dq/dσ \[1/m\]: a thicker line fades less, and s/S is less of it.
    pub by_sigma: f64,
}

impl At {
    const GAUSSIAN: At = At {
        light: 1.0,
        slope: 0.0,
        by_sigma: 0.0,
    };
}

impl Across {
    pub fn new(coefficients: &[f64; ACROSS], sigma_m: f64) -> Across {
        Across {
            coefficients: *coefficients,
            gaussian: coefficients.iter().all(|c| *c == 0.0),
            sigma_m,
        }
    }

    /// At a distance s from the sheet, of 1/S².
    #[inline]
    pub fn at(&self, s: f64, of_total2: f64) -> At {
        if self.gaussian {
            return At::GAUSSIAN;
        }
        self.series(s, of_total2.sqrt(), &mut [0.0; ACROSS])
    }

    /// For places whose 1/S² is about this.
    pub fn faded(&self, of_total2: f64) -> Faded {
        let mut faded = Faded {
            light: [0.0; POWERS],
            by_fading: [0.0; POWERS],
            gaussian: self.gaussian,
            sigma_m: self.sigma_m,
        };
        faded.light[0] = 1.0;
        if self.gaussian {
            return faded;
        }
        let kappa = self.sigma_m * of_total2.sqrt();
        let mut fading = kappa * kappa;
        for (n, (c, he)) in (FIRST..).zip(self.coefficients.iter().zip(&HERMITE[FIRST..])) {
            fading *= kappa;
            let term = c * fading;
            let by = n as f64 * term;
            for (q, he) in faded.light.iter_mut().zip(he) {
                *q += term * he;
            }
            for (f, he) in faded.by_fading.iter_mut().zip(he) {
                *f += by * he;
            }
        }
        faded
    }

    /// The same with dq/dcₙ.
    #[inline]
    pub fn at_by(&self, s: f64, of_total2: f64, by: &mut [f64; ACROSS]) -> At {
        self.series(s, of_total2.sqrt(), by)
    }

    #[inline(always)]
    fn series(&self, s: f64, of_total: f64, by: &mut [f64; ACROSS]) -> At {
        let x = s * of_total;
        let kappa = self.sigma_m * of_total;
        let (mut by_x, mut by_fading) = (0.0, 0.0);
        let mut out = At::GAUSSIAN;
        // He₁, He₂, κ².
        let (mut before, mut here, mut fading) = (x, x * x - 1.0, kappa * kappa);
        for (n, c) in self.coefficients.iter().enumerate() {
            let order = (FIRST + n) as f64;
            // Heₙ₊₁ = x Heₙ − n Heₙ₋₁, Heₙ' = n Heₙ₋₁.
            (before, here) = (here, x * here - (order - 1.0) * before);
            fading *= kappa;
            let term = c * fading;
            by[n] = fading * here;
            out.light += term * here;
            by_x += order * term * before;
            by_fading += order * term * here;
        }
        out.slope = by_x * of_total;
        // d ln κ/dσ = (1 − κ²)/σ, dx/dσ = −x σ/S².
        out.by_sigma =
            by_fading * (1.0 - kappa * kappa) / self.sigma_m - by_x * x * kappa * of_total;
        out
    }
}

impl Faded {
    /// At a distance s from the sheet, of 1/S².
    #[inline]
    pub fn at(&self, s: f64, of_total2: f64) -> At {
        if self.gaussian {
            return At::GAUSSIAN;
        }
        let of_total = of_total2.sqrt();
        let (x, kappa) = (s * of_total, self.sigma_m * of_total);
        let (mut light, mut by_x, mut by_fading) = (0.0, 0.0, 0.0);
        for (q, f) in self.light.iter().zip(&self.by_fading).rev() {
            by_x = by_x * x + light;
            light = light * x + q;
            by_fading = by_fading * x + f;
        }
        At {
            light,
            slope: by_x * of_total,
            by_sigma: by_fading * (1.0 - kappa * kappa) / self.sigma_m
                - by_x * x * kappa * of_total,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_faded_series_is_the_series() {
        let (sigma, blur) = (2.0f64, 1.1f64);
        let of_total2 = sigma.hypot(blur).powi(-2);
        let across = Across::new(&LINE, sigma);
        let faded = across.faded(of_total2);
        for s in [-7.0, -1.7, 0.0, 0.4, 2.5, 6.0f64] {
            let (a, b) = (across.at(s, of_total2), faded.at(s, of_total2));
            assert!((a.light - b.light).abs() < 1e-10, "{s}: {a:?} {b:?}");
            assert!((a.slope - b.slope).abs() < 1e-10, "{s}: {a:?} {b:?}");
            assert!((a.by_sigma - b.by_sigma).abs() < 1e-10, "{s}: {a:?} {b:?}");
        }
    }

    const LINE: [f64; ACROSS] = [0.03, -0.04, 0.01, 0.006, -1e-3, 2e-4, 3e-5, -1e-5];

    /// Light of a line by the closed form, and by adding up its own Gaussian pieces blurred.
    #[test]
    fn blur_fades_the_terms() {
        let (sigma, blur) = (2.0f64, 1.1f64);
        let sharp = Across::new(&LINE, sigma);
        let total = sigma.hypot(blur);
        for s in [-5.0, -1.7, 0.0, 0.4, 2.5, 6.0f64] {
            let closed = sigma / total
                * (-0.5 * (s / total).powi(2)).exp()
                * sharp.at(s, total.powi(-2)).light;
            let (mut sum, step) = (0.0, 0.01);
            for k in -2000..=2000 {
                let by = f64::from(k) * step;
                let light = (-0.5 * ((s - by) / sigma).powi(2)).exp()
                    * sharp.at(s - by, sigma.powi(-2)).light;
                sum += light * (-0.5 * (by / blur).powi(2)).exp() * step;
            }
            let summed = sum / (blur * std::f64::consts::TAU.sqrt());
            assert!((closed - summed).abs() < 1e-6, "{s}: {closed} {summed}");
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let (sigma, blur, s, h) = (2.0f64, 1.1f64, 1.3f64, 1e-5);
        let q = |c: &[f64; ACROSS], sigma: f64, s: f64| {
            let total = sigma.hypot(blur);
            Across::new(c, sigma).at(s, total.powi(-2)).light
        };
        let total = sigma.hypot(blur);
        let across = Across::new(&LINE, sigma);
        let mut by_terms = [0.0; ACROSS];
        let at = across.at_by(s, total.powi(-2), &mut by_terms);
        let by_s = (q(&LINE, sigma, s + h) - q(&LINE, sigma, s - h)) / (2.0 * h);
        assert!((by_s - at.slope).abs() < 1e-8, "{by_s}");
        let by_sigma = (q(&LINE, sigma + h, s) - q(&LINE, sigma - h, s)) / (2.0 * h);
        assert!((by_sigma - at.by_sigma).abs() < 1e-8, "{by_sigma}");
        for n in 0..ACROSS {
            let mut more = LINE;
            more[n] += h;
            let by = (q(&more, sigma, s) - at.light) / h;
            assert!((by - by_terms[n]).abs() < 1e-6, "{n}: {by}");
        }
    }
}
