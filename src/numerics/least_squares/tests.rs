use super::*;
use nalgebra::{DMatrix, DVector, SMatrix, SVector, U2, U4, Vector2};
use proptest::prelude::*;

/// The model is not defined here.
#[derive(Debug, PartialEq)]
struct Undefined;

/// Residuals and their exact derivatives for `N` unknowns, with bounds and units.
struct Exact<F, const N: usize> {
    /// Residuals and rows of the Jacobian at x.
    model: F,
    bounds: [[f64; 2]; N],
    held: [bool; N],
    /// Steps below this share of `units` end the search.
    negligible: f64,
    /// Size of each unknown.
    units: [f64; N],
    costs: usize,
}

impl<F, const N: usize> Exact<F, N> {
    fn new(model: F) -> Self {
        Exact {
            model,
            bounds: [[f64::NEG_INFINITY, f64::INFINITY]; N],
            held: [false; N],
            negligible: 0.0,
            units: [1.0; N],
            costs: 0,
        }
    }
}

type Rows<const N: usize> = Vec<(f64, [f64; N])>;

fn sum<const N: usize>(rows: &Rows<N>) -> f64 {
    0.5 * rows.iter().map(|(r, _)| r * r).sum::<f64>()
}

impl<F: Fn([f64; N]) -> Option<Rows<N>>, const N: usize> LeastSquares<nalgebra::Const<N>>
    for Exact<F, N>
{
    type Point = SVector<f64, N>;
    type Evaluated = Rows<N>;
    type Error = Undefined;

    fn cost(&mut self, at: &Self::Point, rows: &mut Rows<N>) -> Option<f64> {
        self.costs += 1;
        *rows = (self.model)((*at).into())?;
        Some(sum(rows))
    }
    fn begin(&mut self, at: &Self::Point, rows: &mut Rows<N>) -> Result<(), Undefined> {
        self.cost(at, rows).map(drop).ok_or(Undefined)
    }
    fn linearise(
        &mut self,
        _: &Self::Point,
        rows: &Rows<N>,
    ) -> Result<Normal<nalgebra::Const<N>>, Undefined> {
        let mut normal = Normal {
            cost: sum(rows),
            gradient: SVector::zeros(),
            hessian: SMatrix::zeros(),
        };
        for (r, row) in rows {
            let j = SVector::from(*row);
            normal.gradient += j * *r;
            normal.hessian += j * j.transpose();
        }
        Ok(normal)
    }
    fn moved(&self, at: &Self::Point, step: &SVector<f64, N>) -> Option<Self::Point> {
        Some(SVector::from_fn(|k, _| {
            (at[k] + step[k]).clamp(self.bounds[k][0], self.bounds[k][1])
        }))
    }
    fn moves(&self, at: &Self::Point, gradient: &SVector<f64, N>, k: usize) -> bool {
        let [low, high] = self.bounds[k];
        !(self.held[k]
            || (at[k] <= low && gradient[k] > 0.0)
            || (at[k] >= high && gradient[k] < 0.0))
    }
    fn negligible(&self, _: &Self::Point, _: &Self::Point, step: &SVector<f64, N>) -> bool {
        (0..N).all(|k| step[k].abs() <= self.negligible * self.units[k])
    }
}

fn rosenbrock([x, y]: [f64; 2]) -> Option<Rows<2>> {
    Some(vec![
        (10.0 * (y - x * x), [-20.0 * x, 10.0]),
        (1.0 - x, [-1.0, 0.0]),
    ])
}

/// Powell's singular function: the Hessian has rank 2 at its minimum.
fn powell([a, b, c, d]: [f64; 4]) -> Option<Rows<4>> {
    let (root5, root10) = (5f64.sqrt(), 10f64.sqrt());
    let (p, q) = (b - 2.0 * c, a - d);
    Some(vec![
        (a + 10.0 * b, [1.0, 10.0, 0.0, 0.0]),
        (root5 * (c - d), [0.0, 0.0, root5, -root5]),
        (p * p, [0.0, 2.0 * p, -4.0 * p, 0.0]),
        (
            root10 * q * q,
            [2.0 * root10 * q, 0.0, 0.0, -2.0 * root10 * q],
        ),
    ])
}

#[test]
fn rosenbrock_from_the_classic_start() {
    let mut problem = Exact::new(rosenbrock);
    let found = minimise(&mut problem, Vector2::new(-1.2, 1.0), &Options::default()).unwrap();
    assert!(found.ended.converged(), "{:?}", found.ended);
    assert!(
        (found.at - Vector2::new(1.0, 1.0)).norm() < 1e-10,
        "{}",
        found.at
    );
    assert!(found.iterations < 40 && found.trials < 60);
    assert_eq!(problem.costs, found.trials + 1);
}

#[test]
fn powell_s_singular_function_ends_at_its_minimum_though_the_hessian_is_none() {
    let mut problem = Exact::new(powell);
    let start = SVector::from([3.0, -1.0, 0.0, 1.0]);
    let found = minimise(&mut problem, start, &Options::default()).unwrap();
    // The minimum is flat to fourth order: the cost halves four times per step, for as long as it is asked to.
    assert!(found.normal.cost < 1e-20, "{}", found.normal.cost);
    assert!(found.at.amax() < 1e-4, "{}", found.at);
    let enough = Options {
        decrease_absolute: 1e-12,
        ..Options::default()
    };
    let sooner = minimise(&mut Exact::new(powell), start, &enough).unwrap();
    assert_eq!(sooner.ended, Ended::Decrease);
    assert!(sooner.iterations < found.iterations);
}

/// Decay a exp(-b t) + c, seen at ten places: amplitude, rate and level in whatever units.
fn decay(units: [f64; 3], data: impl Fn(f64) -> f64) -> impl Fn([f64; 3]) -> Option<Rows<3>> {
    move |x| {
        let [a, b, c] = [0, 1, 2].map(|k| x[k] / units[k]);
        let row = |i: i32| {
            let t = 0.3 * f64::from(i);
            let e = (-b * t).exp();
            let j = [e / units[0], -a * t * e / units[1], 1.0 / units[2]];
            (a * e + c - data(t), j)
        };
        Some((0..10).map(row).collect())
    }
}

fn noisy(t: f64) -> f64 {
    2.0 * (-0.8 * t).exp() + 0.5 + 0.05 * (7.0 * t).sin()
}

#[test]
fn units_do_not_matter_and_powers_of_two_not_to_the_last_bit() {
    let run = |units: [f64; 3]| {
        let mut problem = Exact::new(decay(units, noisy));
        let start = SVector::from(units).component_mul(&SVector::from([1.0, 1.0, 0.0]));
        minimise(&mut problem, start, &Options::default()).unwrap()
    };
    let plain = run([1.0; 3]);
    let powers = [2f64.powi(40), 2f64.powi(-40), 2f64.powi(20)];
    let scaled = run(powers);
    let any = [1e9, 1e-7, 1e5];
    let other = run(any);
    assert!(plain.ended.converged());
    assert_eq!(
        (plain.iterations, plain.trials),
        (scaled.iterations, scaled.trials)
    );
    for k in 0..3 {
        assert_eq!(plain.at[k].to_bits(), (scaled.at[k] / powers[k]).to_bits());
        assert!((plain.at[k] - other.at[k] / any[k]).abs() < 1e-9);
    }
    // Nothing left to gain: the gradient is at right angles to every column.
    for k in 0..3 {
        let size = plain.normal.hessian[(k, k)].sqrt() * plain.normal.cost.sqrt();
        assert!(plain.normal.gradient[k].abs() < 1e-7 * size);
    }
}

/// A problem that allocates nothing, sized at run time: the same numbers in dynamic matrices.
struct AtRunTime<P>(P);

impl<P, const N: usize> LeastSquares<Dyn> for AtRunTime<(P, [(); N])>
where
    P: LeastSquares<nalgebra::Const<N>, Point = SVector<f64, N>>,
{
    type Point = DVector<f64>;
    type Evaluated = P::Evaluated;
    type Error = P::Error;
    fn cost(&mut self, at: &DVector<f64>, evaluated: &mut P::Evaluated) -> Option<f64> {
        self.0.0.cost(&at.fixed_rows::<N>(0).into(), evaluated)
    }
    fn begin(&mut self, at: &DVector<f64>, evaluated: &mut P::Evaluated) -> Result<(), P::Error> {
        self.0.0.begin(&at.fixed_rows::<N>(0).into(), evaluated)
    }
    fn linearise(
        &mut self,
        at: &DVector<f64>,
        evaluated: &P::Evaluated,
    ) -> Result<Normal<Dyn>, P::Error> {
        let n = self
            .0
            .0
            .linearise(&at.fixed_rows::<N>(0).into(), evaluated)?;
        Ok(Normal {
            cost: n.cost,
            gradient: DVector::from_column_slice(n.gradient.as_slice()),
            hessian: DMatrix::from_column_slice(N, N, n.hessian.as_slice()),
        })
    }
    fn moved(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        let (at, step) = (at.fixed_rows::<N>(0).into(), step.fixed_rows::<N>(0).into());
        let next = self.0.0.moved(&at, &step)?;
        Some(DVector::from_column_slice(next.as_slice()))
    }
    fn moves(&self, at: &DVector<f64>, gradient: &DVector<f64>, k: usize) -> bool {
        let (at, gradient) = (
            at.fixed_rows::<N>(0).into(),
            gradient.fixed_rows::<N>(0).into(),
        );
        self.0.0.moves(&at, &gradient, k)
    }
}

#[test]
fn what_is_held_stays_and_the_size_may_be_known_late() {
    let make = || {
        let mut problem = Exact::new(decay([1.0; 3], noisy));
        problem.held[2] = true;
        problem
    };
    let start = SVector::from([1.0, 1.0, 0.47]);
    let fixed = minimise(&mut make(), start, &Options::default()).unwrap();
    let mut late = AtRunTime((make(), [(); 3]));
    let dynamic = minimise(
        &mut late,
        DVector::from_column_slice(start.as_slice()),
        &Options::default(),
    )
    .unwrap();
    assert_eq!((fixed.at[2], dynamic.at[2]), (0.47, 0.47));
    assert!((0..3).all(|k| (fixed.at[k] - dynamic.at[k]).abs() < 1e-10));
    // As if there were two unknowns.
    let mut two = Exact::new(|[a, b]: [f64; 2]| {
        let rows = decay([1.0; 3], noisy)([a, b, 0.47])?;
        Some(rows.into_iter().map(|(r, j)| (r, [j[0], j[1]])).collect())
    });
    let free = minimise(&mut two, Vector2::new(1.0, 1.0), &Options::default()).unwrap();
    assert!((0..2).all(|k| (fixed.at[k] - free.at[k]).abs() < 1e-10));
    let mut all = make();
    all.held = [true; 3];
    let held = minimise(&mut all, start, &Options::default()).unwrap();
    assert_eq!((held.ended, held.at, held.trials), (Ended::Held, start, 0));
}

proptest! {
    /// Two unknowns in a box: the best point of a fine grid is nowhere better.
    #[test]
    fn a_bounded_minimum_is_the_best_point_of_its_box(
        entries in prop::collection::vec(-1.0..1.0f64, 6),
        right in prop::collection::vec(-3.0..3.0f64, 3),
        start in prop::collection::vec(0.0..1.0f64, 2),
    ) {
        let model = move |[x, y]: [f64; 2]| -> Option<Rows<2>> {
            // Slightly curved, so that more than one step is needed, with one minimum still.
            Some((0..3).map(|i| {
                let unit = |k: usize| if i == k { 1.0 } else { 0.0 };
                let (a, b) = (unit(0) + 0.5 * entries[2 * i], unit(1) + 0.5 * entries[2 * i + 1]);
                (a * x + b * y + 0.02 * x * x - right[i], [a + 0.04 * x, b])
            }).collect())
        };
        let cost = |x, y| sum(&model([x, y]).unwrap());
        let mut best = f64::INFINITY;
        for i in 0..=200 {
            for k in 0..=200 {
                best = f64::min(best, cost(f64::from(i) / 200.0, f64::from(k) / 200.0));
            }
        }
        let mut problem = Exact::new(&model);
        problem.bounds = [[0.0, 1.0]; 2];
        let found = minimise(&mut problem, Vector2::new(start[0], start[1]), &Options::default()).unwrap();
        prop_assert!(found.ended.converged(), "{:?}", found.ended);
        prop_assert!(found.at.iter().all(|v| (0.0..=1.0).contains(v)));
        prop_assert!(cost(found.at[0], found.at[1]) <= best + 1e-9, "{} {best}", found.normal.cost);
    }

    /// The gradient of the normal equations is that of the cost.
    #[test]
    fn gradients_are_those_of_the_cost(
        x in prop::collection::vec(-2.0..2.0f64, 4),
    ) {
        let at = SVector::<f64, 4>::from_column_slice(&x);
        let mut problem = Exact::new(powell);
        let mut rows = Rows::default();
        problem.cost(&at, &mut rows);
        let normal: Normal<U4> = problem.linearise(&at, &rows).unwrap();
        let residuals = |x: &[f64], out: &mut [f64]| {
            for (out, (r, _)) in out.iter_mut().zip(powell([x[0], x[1], x[2], x[3]]).unwrap()) {
                *out = r;
            }
            true
        };
        let mut numeric = Differences::new(residuals, 4, &[1e-5; 4]);
        let at_run_time = DVector::from_column_slice(&x);
        let mut evaluated = Vec::new();
        prop_assert_eq!(numeric.cost(&at_run_time, &mut evaluated), Some(normal.cost));
        let by_differences = numeric.linearise(&at_run_time, &evaluated).unwrap();
        for k in 0..4 {
            let h = 1e-5;
            let mut along = |by: f64| {
                let mut moved = at;
                moved[k] += by;
                problem.cost(&moved, &mut rows).unwrap()
            };
            let slope = (along(h) - along(-h)) / (2.0 * h);
            let size = 1.0 + normal.hessian.amax();
            prop_assert!((normal.gradient[k] - slope).abs() < 1e-6 * size, "{} {slope}", normal.gradient[k]);
            prop_assert!((normal.gradient[k] - by_differences.gradient[k]).abs() < 1e-7 * size);
            for j in 0..4 {
                prop_assert!((normal.hessian[(k, j)] - by_differences.hessian[(k, j)]).abs() < 1e-7 * size);
            }
        }
    }

    /// A linear problem is solved by its normal equations, damped or not.
    #[test]
    fn linear_problems_are_solved_exactly(
        entries in prop::collection::vec(-1.0..1.0f64, 8),
        right in prop::collection::vec(-3.0..3.0f64, 4),
    ) {
        let j = DMatrix::from_row_slice(4, 2, &entries);
        prop_assume!(j.clone().svd(false, false).singular_values.min() > 0.05);
        let exact = j.clone().svd(true, true).solve(&DVector::from_vec(right.clone()), 0.0).unwrap();
        let model = |[x, y]: [f64; 2]| -> Option<Rows<2>> {
            Some((0..4).map(|i| (j[(i, 0)] * x + j[(i, 1)] * y - right[i], [j[(i, 0)], j[(i, 1)]])).collect())
        };
        let damped = minimise(&mut Exact::new(model), Vector2::zeros(), &Options::default()).unwrap();
        prop_assert!(damped.ended.converged());
        let undamped = Options { damping: None, jitter: 0.0, iterations_max: 1, ..Options::default() };
        let mut problem = GaussNewton(Exact::new(model));
        let one = minimise(&mut problem, Vector2::zeros(), &undamped).unwrap();
        for k in 0..2 {
            prop_assert!((damped.at[k] - exact[k]).abs() < 1e-6);
            prop_assert!((one.at[k] - exact[k]).abs() < 1e-9);
        }
        prop_assert_eq!((one.iterations, one.trials), (1, 1));
    }
}

/// A problem that says no cost: it is evaluated when linearised.
struct GaussNewton<P>(P);

impl<D: Dim, P: LeastSquares<D>> LeastSquares<D> for GaussNewton<P>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    type Point = P::Point;
    type Evaluated = ();
    type Error = P::Error;
    fn begin(&mut self, _: &P::Point, (): &mut ()) -> Result<(), P::Error> {
        Ok(())
    }
    fn linearise(&mut self, at: &P::Point, (): &()) -> Result<Normal<D>, P::Error> {
        let mut evaluated = P::Evaluated::default();
        self.0.cost(at, &mut evaluated);
        self.0.linearise(at, &evaluated)
    }
    fn moved(&self, at: &P::Point, step: &OVector<f64, D>) -> Option<P::Point> {
        self.0.moved(at, step)
    }
    fn negligible(&self, from: &P::Point, to: &P::Point, step: &OVector<f64, D>) -> bool {
        self.0.negligible(from, to, step)
    }
}

#[test]
fn gauss_newton_takes_every_step_and_ends_on_a_short_one() {
    let mut problem = Exact::new(decay([1.0; 3], noisy));
    let start = SVector::from([1.8, 0.9, 0.4]);
    let options = Options::default();
    let damped = minimise(&mut problem, start, &options).unwrap();
    problem.negligible = 1e-9;
    let undamped = Options {
        damping: None,
        ..options
    };
    let found = minimise(&mut GaussNewton(problem), start, &undamped).unwrap();
    assert_eq!(found.ended, Ended::Step);
    assert_eq!(found.iterations, found.trials);
    assert!((found.at - damped.at).norm() < 1e-8);
}

#[test]
fn a_small_decrement_ends_before_the_last_step_is_evaluated() {
    let start = SVector::from([1.8, 0.9, 0.4]);
    let options = Options {
        decrement_enough: 1e-4,
        ..Options::default()
    };
    let full = minimise(
        &mut Exact::new(decay([1.0; 3], noisy)),
        start,
        &Options::default(),
    )
    .unwrap();
    let mut problem = Exact::new(decay([1.0; 3], noisy));
    let found = minimise(&mut problem, start, &options).unwrap();
    assert_eq!(found.ended, Ended::Decrement);
    assert_eq!(
        problem.costs, found.trials,
        "the start and all trials but the last"
    );
    let off = found.at - full.at;
    let squared_sds = off.dot(&(full.normal.hessian * off));
    assert!(squared_sds < 1e-4, "{squared_sds}");
    assert!(found.iterations < full.iterations);
}

#[test]
fn a_search_that_found_no_minimum_says_so() {
    let start = Vector2::new(-1.2, 1.0);
    let few = Options {
        iterations_max: 3,
        ..Options::default()
    };
    let found = minimise(&mut Exact::new(rosenbrock), start, &few).unwrap();
    assert_eq!((found.ended, found.iterations), (Ended::Budget, 3));
    let tries = Options {
        trials_max: 5,
        ..Options::default()
    };
    let found = minimise(&mut Exact::new(rosenbrock), start, &tries).unwrap();
    assert_eq!((found.ended, found.trials), (Ended::Budget, 5));

    // Derivatives with the wrong sign: every step goes uphill.
    let wrong = |x: [f64; 2]| -> Option<Rows<2>> {
        let rows = rosenbrock(x)?;
        Some(rows.into_iter().map(|(r, j)| (r, j.map(|v| -v))).collect())
    };
    let found = minimise(&mut Exact::new(wrong), start, &Options::default()).unwrap();
    assert_eq!((found.ended, found.at), (Ended::Stuck, start));

    // Derivatives that are not numbers.
    let nan = |x: [f64; 2]| -> Option<Rows<2>> {
        let rows = rosenbrock(x)?;
        Some(rows.into_iter().map(|(r, _)| (r, [f64::NAN; 2])).collect())
    };
    let found = minimise(&mut Exact::new(nan), start, &Options::default()).unwrap();
    assert_eq!(found.ended, Ended::Singular);

    // A model that ends just short of where it wants to go: the search creeps up to its border, and stays there.
    let walled = |x: [f64; 2]| if x[0] <= 0.5 { rosenbrock(x) } else { None };
    let mut problem = Exact::new(walled);
    let found = minimise(&mut problem, start, &Options::default()).unwrap();
    assert_eq!(found.ended, Ended::Creeping);
    assert!(found.at[0] <= 0.5 && !found.ended.converged());
    let failed = minimise(&mut problem, Vector2::new(2.0, 1.0), &Options::default());
    assert_eq!(failed.err(), Some(Undefined));

    // Undamped there is nothing to fall back to.
    let undamped = Options {
        damping: None,
        ..Options::default()
    };
    let found = minimise(&mut GaussNewton(Exact::new(nan)), start, &undamped).unwrap();
    assert_eq!((found.ended, found.iterations), (Ended::Singular, 0));
}

#[test]
fn a_cost_with_kinks_is_left_where_little_is_to_be_gained() {
    // A staircase on top of a parabola: below its steps the cost does not follow its derivatives.
    let stairs = |[x, y]: [f64; 2]| -> Option<Rows<2>> {
        let step = 1e-3 * (x * 1e4).floor().rem_euclid(2.0);
        Some(vec![
            (x - 1.0 + step, [1.0, 0.0]),
            (y, [0.0, 1.0]),
            (3.0, [0.0, 0.0]),
        ])
    };
    let options = Options {
        decrement_smooth: 1e-3,
        ..Options::default()
    };
    let start = Vector2::new(4.0, 2.0);
    let found = minimise(&mut Exact::new(stairs), start, &options).unwrap();
    assert!(found.ended.converged(), "{:?}", found.ended);
    assert!(
        (found.at - Vector2::new(1.0, 0.0)).norm() < 0.05,
        "{}",
        found.at
    );
    let plain = minimise(&mut Exact::new(stairs), start, &Options::default()).unwrap();
    assert!(found.trials <= plain.trials);
}

#[test]
fn residuals_alone_are_enough_and_the_border_of_a_model_too() {
    // ln x is not defined left of zero: one-sided differences there.
    let residuals = |x: &[f64], out: &mut [f64]| {
        out[0] = x[0].ln() - 0.5f64.ln();
        out[1] = 0.1 * (x[1] - 3.0);
        out[2] = x[0] * x[1] - 1.5;
        x[0] > 0.0
    };
    let mut problem = Differences::new(residuals, 3, &[1e-6; 2]);
    let start = DVector::from_vec(vec![1e-7, 1.0]);
    let found = minimise(&mut problem, start, &Options::default()).unwrap();
    assert!(found.ended.converged(), "{:?}", found.ended);
    assert!((found.at[0] - 0.5).abs() < 1e-6 && (found.at[1] - 3.0).abs() < 1e-6);
    let mut nan = Differences::new(
        |_: &[f64], out: &mut [f64]| {
            out.fill(f64::NAN);
            true
        },
        1,
        &[1.0],
    );
    let failed = minimise(&mut nan, DVector::zeros(1), &Options::default());
    assert_eq!(failed.err(), Some(NotFinite));
}

#[test]
fn one_damped_step_is_the_solution_of_its_equations() {
    let normal = Normal::<U2> {
        cost: 1.0,
        gradient: Vector2::new(3.0, -2e-6),
        hessian: SMatrix::from([[5.0, 1e-6], [1e-6, 4e-12]]),
    };
    for scaling in [Scaling::UnitDiagonal, Scaling::AsGiven] {
        let options = Options {
            scaling,
            jitter: 0.0,
            ..Options::default()
        };
        let moves = SVector::from([true, true]);
        let step = damped_step(&normal.hessian, &normal.gradient, &moves, 0.7, &options).unwrap();
        let mut damped = normal.hessian;
        for k in 0..2 {
            damped[(k, k)] *= 1.7;
        }
        let left = damped * step + normal.gradient;
        assert!(left[0].abs() < 1e-14 && left[1].abs() < 1e-20, "{left}");
        let moves = SVector::from([false, true]);
        let step = damped_step(&normal.hessian, &normal.gradient, &moves, 0.0, &options).unwrap();
        assert_eq!(step[0], 0.0);
        assert!((step[1] - 5e5).abs() < 1e-7);
    }
}
