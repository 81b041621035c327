//! Normal equations of one linearisation under any random forces and tables: which of these the data say.
//!
//! Restricted likelihood: all numbers integrated out about the linearisation (Patterson and Thompson 1971).

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};

use super::body::Simulated;
use super::fit::{Normal, Problem};
use super::hyper::{CORRELATIONS_S, Cell, Cells, Forces, SIZES, ln_prior};
use super::number_prior::NumberPrior;
use super::prior::PriorTable;
use super::table::TableCell;
use hydroline_numerics::cholesky::ln_determinant;
use hydroline_numerics::{cancel, parallel};

/// Normal equations by DOF and cell, of one linearisation.
pub(super) struct Equations<'a> {
    problem: &'a Problem,
    size: usize,
    known: BTreeMap<(usize, Cell), Normal>,
}

/// Log-likelihood by which a neighbouring size must differ for those beyond it to be asked.
const FLAT: f64 = 0.1;
/// Log-likelihood below the best at which sizes are not followed further.
const FAR: f64 = 6.0;

impl<'a> Equations<'a> {
    pub fn new(problem: &'a Problem, size: usize) -> Self {
        Equations {
            problem,
            size,
            known: BTreeMap::new(),
        }
    }

    pub fn clear(&mut self) {
        self.known.clear();
    }

    fn ask(&mut self, all: &[Simulated], cells: &[(usize, Cell)]) {
        let missing: Vec<(usize, Cell)> = cells
            .iter()
            .filter(|c| !self.known.contains_key(c))
            .copied()
            .collect();
        let made = parallel::map_slice(&missing, |&(d, cell)| {
            cancel::check();
            self.problem.normal(all, d, cell, self.size)
        });
        self.known.extend(missing.into_iter().zip(made));
    }

    /// Information with the prior's, gradient, cost.
    pub fn sum(
        &mut self,
        all: &[Simulated],
        cells: &Cells,
        number_prior: &NumberPrior,
        at: &[f64],
    ) -> (DMatrix<f64>, DVector<f64>, f64) {
        let forces: Vec<(usize, Cell)> = self
            .problem
            .body
            .dofs
            .iter()
            .map(|d| (*d, cells.misfit[*d]))
            .collect();
        self.ask(all, &forces);
        let mut information = DMatrix::zeros(self.size, self.size);
        let mut gradient = DVector::zeros(self.size);
        let mut cost = -number_prior.ln(at, cells);
        for key in &forces {
            if let Some(n) = self.known.get(key) {
                information += &n.information;
                gradient += &n.gradient;
                cost += n.cost;
            }
        }
        number_prior.add(at, cells, &mut information, &mut gradient);
        (information, gradient, cost)
    }

    /// Minus log of what the data say of these cells, all numbers integrated out about the linearisation.
    pub fn restricted(
        &mut self,
        all: &[Simulated],
        cells: &Cells,
        number_prior: &NumberPrior,
        at: &[f64],
    ) -> f64 {
        let problem = self.problem;
        let prior = &problem.body.prior;
        let (information, gradient, cost) = self.sum(all, cells, number_prior, at);
        let Some(root) = Cholesky::new(information) else {
            return f64::INFINITY;
        };
        let gain = 0.5 * gradient.dot(&root.solve(&gradient));
        let dofs = self.problem.body.dofs.iter();
        let forces: f64 = dofs.map(|d| ln_prior(cells.misfit[*d], prior)).sum();
        cost - gain + 0.5 * ln_determinant(&root) - forces - number_prior.ln_cells(cells)
    }

    /// The likeliest cells, by steps to neighbours in each DOF in turn.
    pub fn choose(
        &mut self,
        all: &[Simulated],
        cells: Cells,
        number_prior: &NumberPrior,
        at: &[f64],
    ) -> (Cells, f64) {
        let dofs = self.problem.body.dofs.clone();
        self.choose_in(&dofs, all, cells, number_prior, at)
    }

    /// The same with random forces chosen in these DOFs only.
    pub fn choose_in(
        &mut self,
        dofs: &[usize],
        all: &[Simulated],
        mut cells: Cells,
        number_prior: &NumberPrior,
        at: &[f64],
    ) -> (Cells, f64) {
        let mut best = self.restricted(all, &cells, number_prior, at);
        for _ in 0..3 {
            let mut moved = false;
            for block in &number_prior.blocks {
                // Cheap: the data's part is the same for every one.
                let chosen = cells.table(block.candidate);
                let mut next = chosen;
                for cell in TableCell::all() {
                    cells.tables.insert(block.candidate, cell);
                    let cost = self.restricted(all, &cells, number_prior, at);
                    if cost < best - 1e-6 {
                        (best, next) = (cost, cell);
                    }
                }
                cells.tables.insert(block.candidate, next);
                moved |= next != chosen;
            }
            for &d in dofs {
                loop {
                    let around = neighbours(cells.misfit[d], &self.problem.body.prior);
                    let asked: Vec<(usize, Cell)> = around.iter().map(|c| (d, *c)).collect();
                    self.ask(all, &asked);
                    let mut next = None;
                    for cell in around {
                        let mut tried = cells.clone();
                        tried.misfit[d] = cell;
                        let cost = self.restricted(all, &tried, number_prior, at);
                        if cost < best - 1e-6 {
                            best = cost;
                            next = Some(cell);
                        }
                    }
                    match next {
                        Some(cell) => cells.misfit[d] = cell,
                        None => break,
                    }
                    moved = true;
                }
            }
            if !moved || dofs.len() <= 1 && number_prior.blocks.is_empty() {
                break;
            }
        }
        (cells, best)
    }

    /// Per DOF the probabilities of the random force's cells, and the log of the sum over cells over the chosen one.
    pub fn forces(
        &mut self,
        all: &[Simulated],
        cells: &Cells,
        number_prior: &NumberPrior,
        at: &[f64],
    ) -> (Forces, f64) {
        let dofs = self.problem.body.dofs.clone();
        let problem = self.problem;
        let prior = &problem.body.prior;
        let best = self.restricted(all, cells, number_prior, at);
        let mut more = 0.0;
        for block in &number_prior.blocks {
            let mut tried = cells.clone();
            let each = TableCell::all().map(|cell| {
                tried.tables.insert(block.candidate, cell);
                beside(best - self.restricted(all, &tried, number_prior, at))
            });
            let chosen = cells.table(block.candidate).ln_prior(block.median);
            more += each.sum::<f64>().ln() + chosen;
        }
        let mut forces = Vec::new();
        for &d in &dofs {
            let mut found: BTreeMap<Cell, f64> = BTreeMap::new();
            for correlation in 0..CORRELATIONS_S.len() {
                let here = Cell {
                    correlation,
                    ..cells.misfit[d]
                };
                let cost = |me: &mut Self, cell: Cell| {
                    let mut tried = cells.clone();
                    tried.misfit[d] = cell;
                    me.restricted(all, &tried, number_prior, at) + ln_prior(cell, prior)
                };
                let middle = cost(self, here);
                found.insert(here, middle);
                for up in [true, false] {
                    let mut last = middle;
                    let mut flat = false;
                    let mut size = here.size;
                    loop {
                        if (up && size + 1 == SIZES.len()) || (!up && size == 0) {
                            break;
                        }
                        size = if up { size + 1 } else { size - 1 };
                        let cell = Cell { size, correlation };
                        let now = if flat { last } else { cost(self, cell) };
                        found.insert(cell, now);
                        flat |= !up && (now - last).abs() < FLAT && SIZES[size] < 1.0;
                        if now > best + FAR + 6.0 {
                            break;
                        }
                        last = now;
                    }
                }
            }
            let reference = found.values().copied().fold(f64::INFINITY, f64::min);
            let mut each: Vec<(Cell, f64)> = found
                .iter()
                .map(|(cell, cost)| (*cell, (reference - cost + ln_prior(*cell, prior)).exp()))
                .collect();
            let sum: f64 = each.iter().map(|c| c.1).sum();
            each.iter_mut().for_each(|c| c.1 /= sum);
            forces.push((d, each));
            let chosen = found.get(&cells.misfit[d]).copied().unwrap_or(reference);
            let own = ln_prior(cells.misfit[d], prior);
            let each = found
                .iter()
                .map(|(cell, cost)| beside(chosen - cost + ln_prior(*cell, prior) - own));
            more += each.sum::<f64>().ln() + own;
        }
        (forces, more)
    }
}

/// Weight of a cell beside the one chosen, by their difference. Where another one is likelier, the fit is not where it
/// should be: what it says beyond its own place is no evidence.
fn beside(ln: f64) -> f64 {
    ln.min(0.0).exp()
}

/// Cells one step away; where the model may be exact none at all is one of them, for between it and a force that shows lie sizes
/// that are less likely than either.
fn neighbours(cell: Cell, prior: &PriorTable) -> Vec<Cell> {
    let Cell { size, correlation } = cell;
    let mut made = Vec::new();
    let mut push = |size: usize, correlation: usize| {
        if size < SIZES.len() && correlation < CORRELATIONS_S.len() {
            made.push(Cell { size, correlation });
        }
    };
    push(size + 1, correlation);
    push(size.wrapping_sub(1), correlation);
    if size > 0 {
        push(size, correlation + 1);
        push(size, correlation.wrapping_sub(1));
    }
    if size > 1 && prior.exact > 0.0 {
        push(0, correlation);
    }
    made
}
