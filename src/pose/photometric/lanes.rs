//! Products of derivatives summed over pixels, several pixels at a time.
//!
//! A sum of N (N + 1) / 2 products per pixel is what a frame spends most on. Pixels wait here until
//! there are [`LANES`] of them; then each product is summed over all in registers.

use wide::f64x4;

/// Pixels that are added up together, at most: most strips are no longer.
pub(super) const LANES: usize = 20;

/// Pixels that wait to be added up, with N derivatives each.
pub(super) struct Lanes<const N: usize> {
    j: [[f64; LANES]; N],
    weight: [f64; LANES],
    residual: [f64; LANES],
    len: usize,
}

/// Four numbers at a time.
type Fours<const F: usize> = [f64x4; F];

fn fours<const F: usize>(v: &[f64; LANES]) -> Fours<F> {
    std::array::from_fn(|k| f64x4::from([v[4 * k], v[4 * k + 1], v[4 * k + 2], v[4 * k + 3]]))
}

fn sum_of_products<const F: usize>(a: &Fours<F>, b: &Fours<F>) -> f64 {
    let mut sum = a[0] * b[0];
    for k in 1..F {
        sum += a[k] * b[k];
    }
    sum.reduce_add()
}

impl<const N: usize> Lanes<N> {
    pub fn new() -> Self {
        Lanes {
            j: [[0.0; LANES]; N],
            weight: [0.0; LANES],
            residual: [0.0; LANES],
            len: 0,
        }
    }

    /// Takes a pixel; true where none more fits.
    #[inline]
    pub fn push(&mut self, j: &[f64; N], weight: f64, residual: f64) -> bool {
        self.push_first::<N>(j, weight, residual)
    }

    /// The same of the first K derivatives alone.
    #[inline]
    pub fn push_first<const K: usize>(&mut self, j: &[f64; N], weight: f64, residual: f64) -> bool {
        let at = self.len % LANES;
        for (lanes, j) in self.j.iter_mut().zip(j).take(K) {
            lanes[at] = *j;
        }
        self.weight[at] = weight;
        self.residual[at] = residual;
        self.len = at + 1;
        self.len == LANES
    }

    /// Adds what waits to the lower triangle of Jᵀ W J and to Jᵀ W r, and forgets it.
    pub fn empty_into(&mut self, information: &mut [[f64; N]; N], gradient: &mut [f64; N]) {
        self.empty_first_into::<N, N>(information, gradient);
    }

    /// The same of the first K derivatives alone; of those after the first OWN no products with each other.
    #[inline]
    pub fn empty_first_into<const K: usize, const OWN: usize>(
        &mut self,
        information: &mut [[f64; N]; N],
        gradient: &mut [f64; N],
    ) {
        if self.len == 0 {
            return;
        }
        // Of the rest the old derivatives count for nothing.
        let used = self.len.div_ceil(4);
        self.weight[self.len..4 * used].fill(0.0);
        self.len = 0;
        match used {
            1 => self.add_up::<K, OWN, 1>(information, gradient),
            2 => self.add_up::<K, OWN, 2>(information, gradient),
            3 => self.add_up::<K, OWN, 3>(information, gradient),
            4 => self.add_up::<K, OWN, 4>(information, gradient),
            _ => self.add_up::<K, OWN, { LANES / 4 }>(information, gradient),
        }
    }

    /// The same of the first F fours of pixels.
    #[inline]
    fn add_up<const K: usize, const OWN: usize, const F: usize>(
        &self,
        information: &mut [[f64; N]; N],
        gradient: &mut [f64; N],
    ) {
        let weight = fours::<F>(&self.weight);
        let residual = fours::<F>(&self.residual);
        for (a, (row, slope)) in information.iter_mut().zip(gradient).enumerate().take(K) {
            let j = fours::<F>(&self.j[a]);
            let weighted: Fours<F> = std::array::from_fn(|k| j[k] * weight[k]);
            *slope += sum_of_products(&weighted, &residual);
            for (sum, j) in row.iter_mut().zip(&self.j[..=a.min(OWN - 1)]) {
                *sum += sum_of_products(&weighted, &fours::<F>(j));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_the_sums_one_by_one() {
        let mut lanes = Lanes::<3>::new();
        let (mut information, mut gradient) = ([[0.0; 3]; 3], [0.0; 3]);
        let (mut slow, mut slow_gradient) = ([[0.0; 3]; 3], [0.0; 3]);
        // More than twice what fits, and a rest.
        for k in 0..2 * LANES + 5 {
            let x = k as f64;
            let (j, weight, residual) = ([x.sin(), x.cos(), 1.0], 1.0 + 0.1 * x, (3.0 * x).sin());
            if lanes.push(&j, weight, residual) {
                lanes.empty_into(&mut information, &mut gradient);
            }
            for a in 0..3 {
                slow_gradient[a] += weight * j[a] * residual;
                for b in 0..=a {
                    slow[a][b] += weight * j[a] * j[b];
                }
            }
        }
        lanes.empty_into(&mut information, &mut gradient);
        lanes.empty_into(&mut information, &mut gradient);
        for a in 0..3 {
            assert!((gradient[a] - slow_gradient[a]).abs() < 1e-9);
            for b in 0..=a {
                assert!((information[a][b] - slow[a][b]).abs() < 1e-9, "{a} {b}");
            }
        }
    }
}
