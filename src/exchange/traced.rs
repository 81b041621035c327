//! A scalar that remembers how it was computed: the laws of motion, run once in it, are formulas.
//!
//! What the simulator computes and what is written down for other programs is then one text, the law's own code. A law that looks at
//! a value instead of choosing by [`Real::where_negative`] cannot be written down: the tape keeps what was looked at.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::ops::{Add, Div, Mul, Neg, Sub};

use hydroline_sim::Real;

/// A function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Function {
    /// Sine \[rad\].
    Sin,
    /// Cosine \[rad\].
    Cos,
    /// e^x.
    Exp,
    /// Natural logarithm.
    Ln,
    /// Square root.
    Sqrt,
    /// Hyperbolic tangent.
    Tanh,
    /// Absolute value.
    Abs,
}

impl Function {
    /// Its usual name.
    pub fn name(self) -> &'static str {
        match self {
            Function::Sin => "sin",
            Function::Cos => "cos",
            Function::Exp => "exp",
            Function::Ln => "log",
            Function::Sqrt => "sqrt",
            Function::Tanh => "tanh",
            Function::Abs => "abs",
        }
    }

    fn of(self, x: f64) -> f64 {
        match self {
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Exp => x.exp(),
            Function::Ln => x.ln(),
            Function::Sqrt => x.sqrt(),
            Function::Tanh => x.tanh(),
            Function::Abs => x.abs(),
        }
    }
}

/// Place of a node in its graph.
pub type Place = u32;

/// How a number was made.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Node {
    /// A constant, by its bits.
    Constant(u64),
    /// An input, by its place among the graph's symbols.
    Symbol(usize),
    /// Sum.
    Add(Place, Place),
    /// Difference.
    Sub(Place, Place),
    /// Product.
    Mul(Place, Place),
    /// Quotient.
    Div(Place, Place),
    /// Negative.
    Neg(Place),
    /// A function's value.
    Call(Function, Place),
    /// The larger of two.
    Max(Place, Place),
    /// The smaller of two.
    Min(Place, Place),
    /// The second where the first is below 0, else the third.
    Where(Place, Place, Place),
    /// Value of a table at equally spaced points over a range (bits of its ends), at the last place.
    Table(Vec<Place>, [u64; 2], Place),
}

impl Node {
    /// Nodes that it is made of.
    pub fn parts(&self) -> Vec<Place> {
        match self {
            Node::Constant(_) | Node::Symbol(_) => Vec::new(),
            Node::Neg(a) | Node::Call(_, a) => vec![*a],
            Node::Add(a, b)
            | Node::Sub(a, b)
            | Node::Mul(a, b)
            | Node::Div(a, b)
            | Node::Max(a, b)
            | Node::Min(a, b) => vec![*a, *b],
            Node::Where(a, b, c) => vec![*a, *b, *c],
            Node::Table(values, _, at) => values.iter().chain([at]).copied().collect(),
        }
    }
}

/// All that was computed between two moments.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    /// Nodes; each is made of earlier ones.
    pub nodes: Vec<Node>,
    /// Names of the inputs.
    pub symbols: Vec<String>,
    /// Nodes whose value was looked at.
    pub looked_at: Vec<Place>,
    known: HashMap<Node, Place>,
}

thread_local! {
    static TAPE: RefCell<Graph> = RefCell::new(Graph::default());
}

impl Graph {
    fn place(&mut self, node: Node) -> Place {
        if let Some(place) = self.known.get(&node) {
            return *place;
        }
        let place = self.nodes.len() as Place;
        self.nodes.push(node.clone());
        self.known.insert(node, place);
        place
    }

    /// The node at a place.
    pub fn node(&self, place: Place) -> &Node {
        &self.nodes[place as usize]
    }

    /// Symbols that nodes are made of, by place among the graph's symbols.
    pub fn symbols_of(&self, places: &[Place]) -> Vec<usize> {
        let mut seen = vec![false; self.nodes.len()];
        let mut open = places.to_vec();
        let mut found = Vec::new();
        while let Some(place) = open.pop() {
            if std::mem::replace(&mut seen[place as usize], true) {
                continue;
            }
            if let Node::Symbol(symbol) = self.node(place) {
                found.push(*symbol);
            }
            open.extend(self.node(place).parts());
        }
        found.sort_unstable();
        found
    }
}

/// Runs what computes with traced numbers; its result and the graph of all of them.
pub fn record<R>(compute: impl FnOnce() -> R) -> (R, Graph) {
    TAPE.with(|tape| *tape.borrow_mut() = Graph::default());
    let result = compute();
    let graph = TAPE.with(|tape| std::mem::take(&mut *tape.borrow_mut()));
    (result, graph)
}

/// A number with its place on the tape of its thread.
#[derive(Debug, Clone, Copy)]
pub struct Traced {
    place: Place,
    value: f64,
}

impl Traced {
    /// An input of this name; `value` is one that it may have.
    pub fn symbol(name: &str, value: f64) -> Traced {
        TAPE.with(|tape| {
            let mut graph = tape.borrow_mut();
            let symbol = graph.symbols.len();
            graph.symbols.push(name.to_owned());
            let place = graph.place(Node::Symbol(symbol));
            Traced { place, value }
        })
    }

    /// Its place in the graph.
    pub fn place(self) -> Place {
        self.place
    }

    fn new(node: Node, value: f64) -> Traced {
        let place = TAPE.with(|tape| tape.borrow_mut().place(node));
        Traced { place, value }
    }

    fn is_constant(self) -> bool {
        TAPE.with(|tape| matches!(tape.borrow().node(self.place), Node::Constant(_)))
    }

    /// The number, where it is the same always.
    fn constant(self) -> Option<f64> {
        self.is_constant().then_some(self.value)
    }

    fn is(self, value: f64) -> bool {
        self.constant() == Some(value)
    }

    fn call(self, function: Function) -> Traced {
        let value = function.of(self.value);
        match self.is_constant() {
            true => Traced::from_f64(value),
            false => Traced::new(Node::Call(function, self.place), value),
        }
    }

    fn both(self, other: Traced, value: f64, node: impl Fn(Place, Place) -> Node) -> Traced {
        if self.is_constant() && other.is_constant() {
            return Traced::from_f64(value);
        }
        Traced::new(node(self.place, other.place), value)
    }
}

impl PartialEq for Traced {
    fn eq(&self, other: &Self) -> bool {
        self.value() == other.value()
    }
}

impl PartialOrd for Traced {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value().partial_cmp(&other.value())
    }
}

// Sums with 0, products with 0 and 1 are left out: they change no bit of a finite number.
impl Add for Traced {
    type Output = Traced;
    fn add(self, other: Traced) -> Traced {
        if other.is(0.0) {
            self
        } else if self.is(0.0) {
            other
        } else {
            self.both(other, self.value + other.value, Node::Add)
        }
    }
}

impl Sub for Traced {
    type Output = Traced;
    fn sub(self, other: Traced) -> Traced {
        if other.is(0.0) {
            self
        } else if self.is(0.0) {
            -other
        } else {
            self.both(other, self.value - other.value, Node::Sub)
        }
    }
}

impl Mul for Traced {
    type Output = Traced;
    fn mul(self, other: Traced) -> Traced {
        if self.is(0.0) || other.is(0.0) {
            Traced::from_f64(0.0)
        } else if other.is(1.0) {
            self
        } else if self.is(1.0) {
            other
        } else if other.is(-1.0) {
            -self
        } else {
            self.both(other, self.value * other.value, Node::Mul)
        }
    }
}

impl Mul<f64> for Traced {
    type Output = Traced;
    fn mul(self, factor: f64) -> Traced {
        self * Traced::from_f64(factor)
    }
}

impl Div for Traced {
    type Output = Traced;
    fn div(self, other: Traced) -> Traced {
        if other.is(1.0) || self.is(0.0) {
            self
        } else {
            self.both(other, self.value / other.value, Node::Div)
        }
    }
}

impl Neg for Traced {
    type Output = Traced;
    fn neg(self) -> Traced {
        let inner = TAPE.with(|tape| match tape.borrow().node(self.place) {
            Node::Neg(inner) => Some(*inner),
            _ => None,
        });
        match (inner, self.constant()) {
            (Some(place), _) => Traced {
                place,
                value: -self.value,
            },
            (None, Some(value)) => Traced::from_f64(-value),
            (None, None) => Traced::new(Node::Neg(self.place), -self.value),
        }
    }
}

impl Real for Traced {
    fn from_f64(value: f64) -> Self {
        Traced::new(Node::Constant(value.to_bits()), value)
    }

    fn value(self) -> f64 {
        TAPE.with(|tape| tape.borrow_mut().looked_at.push(self.place));
        self.value
    }

    fn sin(self) -> Self {
        self.call(Function::Sin)
    }

    fn cos(self) -> Self {
        self.call(Function::Cos)
    }

    fn exp(self) -> Self {
        self.call(Function::Exp)
    }

    fn ln(self) -> Self {
        self.call(Function::Ln)
    }

    fn sqrt(self) -> Self {
        self.call(Function::Sqrt)
    }

    fn tanh(self) -> Self {
        self.call(Function::Tanh)
    }

    fn abs(self) -> Self {
        self.call(Function::Abs)
    }

    fn max(self, other: Self) -> Self {
        self.both(other, f64::max(self.value, other.value), Node::Max)
    }

    fn min(self, other: Self) -> Self {
        self.both(other, f64::min(self.value, other.value), Node::Min)
    }

    fn where_negative(self, negative: Self, otherwise: Self) -> Self {
        let chosen = if self.value < 0.0 {
            negative
        } else {
            otherwise
        };
        if self.is_constant() || negative.place == otherwise.place {
            return chosen;
        }
        let node = Node::Where(self.place, negative.place, otherwise.place);
        Traced::new(node, chosen.value)
    }

    fn looked_up(table: &[Self], range: (f64, f64), at: Self) -> Self {
        let numbers: Vec<f64> = table.iter().map(|v| v.value).collect();
        let value = f64::looked_up(&numbers, range, at.value);
        let places = table.iter().map(|v| v.place).collect();
        let ends = [range.0.to_bits(), range.1.to_bits()];
        Traced::new(Node::Table(places, ends, at.place), value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_graph_holds_what_was_computed_once_and_nothing_that_changes_no_bit() {
        let (y, graph) = record(|| {
            let x = Traced::symbol("x", 2.0);
            let square = x * x;
            let again = x * x;
            (square + Traced::zero()) * 1.0 + again * Traced::from_f64(3.0) - Traced::zero()
        });
        assert_eq!(y.value, 16.0);
        // x, x*x, 3, their product, the sum; 0 and 1 are constants that nothing is made of.
        let used: Vec<&Node> = graph
            .nodes
            .iter()
            .filter(|n| !n.parts().is_empty())
            .collect();
        assert_eq!(used.len(), 3, "{used:?}");
        assert!(graph.looked_at.is_empty());
        assert_eq!(graph.symbols_of(&[y.place()]), [0]);
    }

    #[test]
    fn a_value_that_was_looked_at_is_known_and_a_choice_by_sign_is_a_node() {
        let ((), graph) = record(|| {
            let x = Traced::symbol("x", -2.0);
            let _ = x.where_negative(Traced::one(), x.abs());
            assert!(graph_is_clean());
            let _ = x > Traced::zero();
        });
        assert_eq!(graph.looked_at.len(), 2);
        assert!(graph.nodes.iter().any(|n| matches!(n, Node::Where(..))));
    }

    fn graph_is_clean() -> bool {
        TAPE.with(|tape| tape.borrow().looked_at.is_empty())
    }
}
