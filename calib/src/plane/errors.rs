//! Errors of a map that all of its points share, as a few displacements of the sheet.
//!
//! A calibration's parameters are uncertain, and each moves all points of the sheet at once. Of the displacements that their
//! covariance allows, the principal ones are kept (Karhunen and Loève's expansion on a grid of pixels): independent, each
//! given for an error of one standard deviation.

use nalgebra::{DMatrix, Matrix2xX, SymmetricEigen};

use super::{ImageSize, PlaneMap};

/// Nodes of the grid along the image's width and height: the displacements of a lens and a port are smooth.
const NODES: usize = 33;
/// Displacements are left out together where they hold less than this share of the mean square: a hundredth of the sd.
const REST_SHARE: f64 = 1e-4;

/// Principal displacements of the sheet by what a map's parameters are uncertain by.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapErrors {
    /// Distance of the nodes \[px\].
    step_px: [f64; 2],
    /// Of each displacement, column by column of the nodes: (δξ, δη) of an error of one standard deviation \[m\].
    fields: Vec<Vec<[f64; 2]>>,
}

impl MapErrors {
    /// Most displacements that are kept.
    pub const MOST: usize = 8;

    /// Those of a map of images of this size; none where the map takes its numbers as exact.
    pub fn of(map: &dyn PlaneMap, size: ImageSize) -> Self {
        let step_px = [size.width_px, size.height_px]
            .map(|n| f64::from(n.saturating_sub(1)) / (NODES - 1) as f64);
        let covariance = map.parameter_covariance();
        if covariance.nrows() == 0 {
            return MapErrors::default();
        }
        let root = root(&covariance);
        let slopes: Vec<Option<Matrix2xX<f64>>> = nodes()
            .map(|[i, j]| {
                let at = [i as f64 * step_px[0], j as f64 * step_px[1]];
                let by = map.parameter_slopes(at[0], at[1])?;
                let is_sound = by.ncols() == root.nrows() && by.iter().all(|v| v.is_finite());
                is_sound.then(|| by * &root)
            })
            .collect();
        let count = root.ncols();
        let mut squares = DMatrix::zeros(count, count);
        for by in slopes.iter().flatten() {
            squares += by.transpose() * by;
        }
        let principal = SymmetricEigen::new(squares);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| principal.eigenvalues[*b].total_cmp(&principal.eigenvalues[*a]));
        let total: f64 = principal.eigenvalues.iter().sum();
        let mut rest = total;
        let mut fields = Vec::new();
        for k in order.into_iter().take(Self::MOST) {
            if rest.is_nan() || rest <= REST_SHARE * total {
                break;
            }
            rest -= principal.eigenvalues[k];
            let along = principal.eigenvectors.column(k);
            let known = slopes.iter().map(|by| {
                let moved = by.as_ref()? * along;
                Some([moved[0], moved[1]])
            });
            fields.extend(filled(known.collect()));
        }
        MapErrors { step_px, fields }
    }

    /// Number of displacements.
    pub fn len(&self) -> usize {
        self.fields.len()
    }

    /// Whether the map takes its numbers as exact.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// (δξ, δη) \[m\] of the sheet point seen at a pixel, of each displacement.
    pub fn at(&self, column_px: f64, row_px: f64) -> impl Iterator<Item = [f64; 2]> {
        let last = (NODES - 2) as f64;
        let [u, v] = [column_px / self.step_px[0], row_px / self.step_px[1]];
        let [i, j] = [u, v].map(|t| t.floor().clamp(0.0, last));
        let [s, t] = [u - i, v - j];
        let first = i as usize * NODES + j as usize;
        let weights = [
            (0, (1.0 - s) * (1.0 - t)),
            (1, (1.0 - s) * t),
            (NODES, s * (1.0 - t)),
            (NODES + 1, s * t),
        ];
        self.fields.iter().map(move |field| {
            weights.iter().fold([0.0; 2], |sum, (k, weight)| {
                let node = field.get(first + k).copied().unwrap_or_default();
                [sum[0] + weight * node[0], sum[1] + weight * node[1]]
            })
        })
    }
}

fn nodes() -> impl Iterator<Item = [usize; 2]> {
    (0..NODES).flat_map(|i| (0..NODES).map(move |j| [i, j]))
}

/// R with R Rᵀ = Σ, by the eigenvectors of the correlations; what rounding leaves below zero is none.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let sds = covariance.diagonal().map(|v| v.max(0.0).sqrt());
    let correlation = DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        let both = sds[i] * sds[j];
        match both > 0.0 {
            true => 0.5 * (covariance[(i, j)] + covariance[(j, i)]) / both,
            false => 0.0,
        }
    });
    let eigen = SymmetricEigen::new(correlation);
    let lengths = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    DMatrix::from_diagonal(&sds) * eigen.eigenvectors * DMatrix::from_diagonal(&lengths)
}

/// The field with nodes outside of the map's region as their neighbours are, so that it is continued to the region's border; `None`
/// where the map holds at no node.
fn filled(mut known: Vec<Option<[f64; 2]>>) -> Option<Vec<[f64; 2]>> {
    while known.iter().any(Option::is_none) {
        let near = |at: [usize; 2]| {
            let around = |k: usize| at[k].saturating_sub(1)..(at[k] + 2).min(NODES);
            let neighbours = around(0).flat_map(|i| around(1).map(move |j| i * NODES + j));
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for value in neighbours.filter_map(|n| known[n]) {
                sum = [sum[0] + value[0], sum[1] + value[1]];
                count += 1.0;
            }
            (count > 0.0).then(|| sum.map(|v| v / count))
        };
        let found: Vec<Option<[f64; 2]>> = nodes()
            .map(|at| known[at[0] * NODES + at[1]].or_else(|| near(at)))
            .collect();
        if found.iter().all(Option::is_none) {
            return None;
        }
        known = found;
    }
    known.into_iter().collect()
}

#[cfg(test)]
mod tests;
