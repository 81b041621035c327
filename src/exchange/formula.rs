//! A graph as statements of a programming language.

use super::traced::{Function, Graph, Node, Place};

/// Length of an expression from which it gets a name of its own.
const LONGEST: usize = 110;

/// How a language writes what a graph holds.
pub trait Syntax {
    /// A function of one argument.
    fn call(&self, function: Function, of: &str) -> String {
        format!("{}({of})", function.name())
    }
    /// The larger of two.
    fn larger(&self, a: &str, b: &str) -> String {
        format!("max({a}, {b})")
    }
    /// The smaller of two.
    fn smaller(&self, a: &str, b: &str) -> String {
        format!("min({a}, {b})")
    }
    /// `negative` where `of` is below 0, else `otherwise`.
    fn chosen(&self, of: &str, negative: &str, otherwise: &str) -> String;
    /// Value of a table at equally spaced points over a range.
    fn table(&self, values: &[String], range: (f64, f64), at: &str) -> String;
    /// An input by its name.
    fn symbol(&self, name: &str) -> String {
        name.to_owned()
    }
}

/// Functions by their names, f(x): what formulas are compared in.
#[derive(Debug, Clone, Copy)]
pub struct Plain;

impl Syntax for Plain {
    fn chosen(&self, of: &str, negative: &str, otherwise: &str) -> String {
        format!("chosen({of}, {negative}, {otherwise})")
    }

    fn table(&self, values: &[String], (from, to): (f64, f64), at: &str) -> String {
        let ends = format!("{}, {}", number(from), number(to));
        format!("table([{}], {ends}, {at})", values.join(", "))
    }
}

/// Binding of an expression's outermost operator.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Sum,
    Product,
    Sign,
    Whole,
}

/// Statements and what they compute.
#[derive(Debug, Clone, PartialEq)]
pub struct Formula {
    /// (name, expression) in the order of computing.
    pub statements: Vec<(String, String)>,
    /// An expression for each output.
    pub outputs: Vec<String>,
}

/// A float as Rust, Python, MATLAB and XML read it, to the last bit.
pub fn number(value: f64) -> String {
    format!("{value:?}")
}

struct Writer<'g, S: ?Sized> {
    graph: &'g Graph,
    syntax: &'g S,
    uses: Vec<usize>,
    written: Vec<Option<(String, Binding)>>,
    statements: Vec<(String, String)>,
}

/// Statements that compute the nodes at some places.
pub fn formula(graph: &Graph, outputs: &[Place], syntax: &(impl Syntax + ?Sized)) -> Formula {
    let mut uses = vec![0; graph.nodes.len()];
    for place in outputs {
        uses[*place as usize] += 1;
    }
    // Each node is made of earlier ones: from the last on, each use is counted once.
    for place in (0..graph.nodes.len()).rev() {
        if uses[place] > 0 {
            for part in graph.nodes[place].parts() {
                uses[part as usize] += 1;
            }
        }
    }
    let mut writer = Writer {
        graph,
        syntax,
        written: vec![None; graph.nodes.len()],
        uses,
        statements: Vec::new(),
    };
    for place in 0..graph.nodes.len() {
        if writer.uses[place] > 0 {
            writer.write(place);
        }
    }
    let outputs = outputs.iter();
    let outputs = outputs.map(|p| writer.text(*p, Binding::Sum)).collect();
    Formula {
        statements: writer.statements,
        outputs,
    }
}

impl<S: Syntax + ?Sized> Writer<'_, S> {
    fn write(&mut self, place: usize) {
        let node = &self.graph.nodes[place];
        let (text, binding) = self.expression(node);
        let is_simple = node.parts().is_empty()
            || matches!(node, Node::Neg(a) if self.graph.node(*a).parts().is_empty());
        let is_named = !is_simple && (self.uses[place] > 1 || text.len() > LONGEST);
        self.written[place] = Some(if is_named {
            let name = self.name(node);
            self.statements.push((name.clone(), text));
            (name, Binding::Whole)
        } else {
            (text, binding)
        });
    }

    /// A name that says what it is where that is short, else a number.
    fn name(&self, node: &Node) -> String {
        let of = |place: Place| match self.graph.node(place) {
            Node::Symbol(symbol) => self.graph.symbols.get(*symbol),
            _ => None,
        };
        let named = match node {
            Node::Call(Function::Sin, a) => of(*a).map(|n| format!("sin_{n}")),
            Node::Call(Function::Cos, a) => of(*a).map(|n| format!("cos_{n}")),
            Node::Call(Function::Abs, a) => of(*a).map(|n| format!("abs_{n}")),
            Node::Sub(a, b) => of(*a).zip(of(*b)).and_then(|(rigid, added)| {
                let is_mass = rigid.ends_with("_kg") || rigid.ends_with("_kgm2");
                (is_mass && added.ends_with("dot")).then(|| format!("mass_{}", &added[2..3]))
            }),
            _ => None,
        };
        named.unwrap_or_else(|| format!("a{}", self.statements.len() + 1))
    }

    fn text(&self, place: Place, at_least: Binding) -> String {
        match &self.written[place as usize] {
            Some((text, binding)) if *binding >= at_least => text.clone(),
            Some((text, _)) => format!("({text})"),
            None => String::new(),
        }
    }

    fn expression(&self, node: &Node) -> (String, Binding) {
        use Binding::{Product, Sign, Sum, Whole};
        // Every operator keeps its order: a + (b + c) is another number than (a + b) + c.
        let two = |a: Place, sign: &str, b: Place, own: Binding, right: Binding| {
            let text = format!("{} {sign} {}", self.text(a, own), self.text(b, right));
            (text, own)
        };
        let whole = |place: Place| self.text(place, Sum);
        match node {
            Node::Constant(bits) => {
                let value = f64::from_bits(*bits);
                (number(value), if value < 0.0 { Sum } else { Whole })
            }
            Node::Symbol(symbol) => {
                let name = self.graph.symbols.get(*symbol);
                (self.syntax.symbol(name.map_or("", |n| n)), Whole)
            }
            Node::Add(a, b) => two(*a, "+", *b, Sum, Product),
            Node::Sub(a, b) => two(*a, "-", *b, Sum, Product),
            Node::Mul(a, b) => two(*a, "*", *b, Product, Sign),
            Node::Div(a, b) => two(*a, "/", *b, Product, Sign),
            Node::Neg(a) => (format!("-{}", self.text(*a, Whole)), Sum),
            Node::Call(function, a) => (self.syntax.call(*function, &whole(*a)), Whole),
            Node::Max(a, b) => (self.syntax.larger(&whole(*a), &whole(*b)), Whole),
            Node::Min(a, b) => (self.syntax.smaller(&whole(*a), &whole(*b)), Whole),
            Node::Where(of, negative, otherwise) => {
                let of = self.syntax.chosen(
                    &self.text(*of, Whole),
                    &whole(*negative),
                    &whole(*otherwise),
                );
                (of, Whole)
            }
            Node::Table(values, [from, to], at) => {
                let values: Vec<String> = values.iter().map(|v| whole(*v)).collect();
                let range = (f64::from_bits(*from), f64::from_bits(*to));
                (self.syntax.table(&values, range, &whole(*at)), Whole)
            }
        }
    }
}
