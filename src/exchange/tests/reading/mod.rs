//! A reader of the files that are written: assignments and expressions of Python, CasADi and MATLAB, as far as the writers use them.

use std::collections::HashMap;

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    /// A name with its place among the values.
    Slot(usize),
    Sign(char),
}

fn tokens(text: &str) -> Vec<Token> {
    let letters: Vec<char> = text.chars().collect();
    let mut made = Vec::new();
    let mut k = 0;
    while k < letters.len() {
        let c = letters[k];
        let mut word = |go_on: &dyn Fn(char, Option<char>) -> bool| {
            let from = k;
            while k < letters.len() && go_on(letters[k], k.checked_sub(1).map(|b| letters[b])) {
                k += 1;
            }
            letters[from..k].iter().collect::<String>()
        };
        if c.is_whitespace() {
            k += 1;
        } else if c.is_ascii_digit() {
            let number = word(&|c, before| {
                c.is_ascii_digit() || c == '.' || c == 'e' || (c == '-' && before == Some('e'))
            });
            made.push(Token::Number(number.parse().unwrap()));
        } else if c.is_alphabetic() || c == '_' {
            let name = word(&|c, _| c.is_alphanumeric() || c == '_' || c == '.');
            made.push(Token::Name(name));
        } else {
            made.push(Token::Sign(c));
            k += 1;
        }
    }
    made
}

struct Reader<'a> {
    tokens: &'a [Token],
    at: usize,
    values: &'a [f64],
}

impl Reader<'_> {
    fn sign(&mut self, c: char) -> bool {
        let there = self.tokens.get(self.at) == Some(&Token::Sign(c));
        self.at += usize::from(there);
        there
    }

    fn word(&mut self, word: &str) -> bool {
        let there = matches!(self.tokens.get(self.at), Some(Token::Name(n)) if n == word);
        self.at += usize::from(there);
        there
    }

    /// `a if b < c else d`, or a sum, or a comparison as 1 or 0.
    fn whole(&mut self) -> f64 {
        let value = self.sum();
        if self.word("if") {
            let (left, right) = (self.sum(), {
                assert!(self.sign('<'));
                self.sum()
            });
            assert!(self.word("else"));
            let otherwise = self.whole();
            return if left < right { value } else { otherwise };
        }
        if self.sign('<') {
            return f64::from(value < self.sum());
        }
        value
    }

    fn sum(&mut self) -> f64 {
        let mut value = self.product();
        loop {
            if self.sign('+') {
                value += self.product();
            } else if self.sign('-') {
                value -= self.product();
            } else {
                return value;
            }
        }
    }

    fn product(&mut self) -> f64 {
        let mut value = self.single();
        loop {
            if self.sign('*') {
                value *= self.single();
            } else if self.sign('/') {
                value /= self.single();
            } else {
                return value;
            }
        }
    }

    fn single(&mut self) -> f64 {
        if self.sign('-') {
            return -self.single();
        }
        if self.sign('(') {
            let value = self.whole();
            assert!(self.sign(')'), "{:?}", &self.tokens[self.at..]);
            return value;
        }
        let tokens = self.tokens;
        let token = tokens.get(self.at);
        self.at += 1;
        match token {
            Some(Token::Number(value)) => *value,
            Some(Token::Name(name)) if self.sign('(') => self.call(name),
            Some(Token::Slot(place)) => self.values[*place],
            other => panic!("{other:?}"),
        }
    }

    fn call(&mut self, name: &str) -> f64 {
        let name = name.strip_prefix("ca.").unwrap_or(name);
        if matches!(name, "_table" | "table_at") {
            return self.table();
        }
        let mut given = vec![self.whole()];
        while self.sign(',') {
            given.push(self.whole());
        }
        assert!(self.sign(')'));
        let x = given[0];
        match (name, given.as_slice()) {
            ("sin", [_]) => x.sin(),
            ("cos", [_]) => x.cos(),
            ("exp", [_]) => x.exp(),
            ("log", [_]) => x.ln(),
            ("sqrt", [_]) => x.sqrt(),
            ("tanh", [_]) => x.tanh(),
            ("abs" | "fabs", [_]) => x.abs(),
            ("max" | "fmax", [a, b]) => a.max(*b),
            ("min" | "fmin", [a, b]) => a.min(*b),
            ("chosen", [of, negative, otherwise]) => {
                if *of < 0.0 {
                    *negative
                } else {
                    *otherwise
                }
            }
            ("if_else", [is, then, otherwise]) => {
                if *is != 0.0 {
                    *then
                } else {
                    *otherwise
                }
            }
            _ => panic!("{name} of {given:?}"),
        }
    }

    /// Values in brackets, the ends of their range, the place.
    fn table(&mut self) -> f64 {
        let close = if self.sign('(') { ')' } else { ']' };
        if close == ']' {
            assert!(self.sign('['));
        }
        let mut values = vec![self.whole()];
        while self.sign(',') {
            values.push(self.whole());
        }
        assert!(self.sign(close));
        let mut more = [0.0; 3];
        for value in &mut more {
            assert!(self.sign(','));
            *value = self.whole();
        }
        assert!(self.sign(')'));
        let [low, high, at] = more;
        hydroline_sim::effect::covariate_table::interpolated(&values, (low, high), at)
    }
}

/// Value of tokens.
fn value(tokens: &[Token], values: &[f64]) -> f64 {
    let mut reader = Reader {
        tokens,
        at: 0,
        values,
    };
    let value = reader.whole();
    assert_eq!(reader.at, tokens.len(), "{tokens:?}");
    value
}

/// A file's function: what is assigned, and what it gives back.
#[derive(Debug)]
pub struct Function {
    /// Parameters and inputs with their places among the values.
    slots: HashMap<String, usize>,
    parameters: Vec<(usize, f64)>,
    assigned: Vec<(usize, Vec<Token>)>,
    outputs: Vec<Vec<Token>>,
}

/// Puts places for names; a name before a bracket is a function's.
fn placed(tokens: Vec<Token>, slots: &mut HashMap<String, usize>) -> Vec<Token> {
    let calls: Vec<bool> = (1..=tokens.len())
        .map(|k| tokens.get(k) == Some(&Token::Sign('(')))
        .collect();
    let place = |(token, is_call): (Token, bool)| match token {
        Token::Name(name) if !is_call && name != "if" && name != "else" => {
            let next = slots.len();
            Token::Slot(*slots.entry(name).or_insert(next))
        }
        other => other,
    };
    tokens.into_iter().zip(calls).map(place).collect()
}

/// Reads lines between two that begin with some words.
fn between<'t>(text: &'t str, from: &str, to: &str) -> Vec<&'t str> {
    let lines = text
        .lines()
        .skip_while(|l| !l.trim_start().starts_with(from));
    let body = lines
        .skip(1)
        .take_while(|l| !l.trim_start().starts_with(to));
    body.map(str::trim).collect()
}

impl Function {
    /// Of a file in one of the languages.
    pub fn read(text: &str, target: &str) -> Function {
        let (parameters, body, outputs) = match target {
            "python" => (
                between(text, "PARAMETERS = {", "}"),
                between(text, "def f(", "return ["),
                between(text, "return [", "]"),
            ),
            "casadi" => (
                between(text, "PARAMETERS = {", "}"),
                between(text, "parameters = ca.SX.sym", "rate = ca.vertcat("),
                between(text, "rate = ca.vertcat(", ")"),
            ),
            _ => (
                between(text, "if nargin < 4", "end"),
                between(text, "if nargin == 0", "xdot = ["),
                between(text, "xdot = [", "];"),
            ),
        };
        let cut = |line: &str| {
            let line = line.split('%').next().unwrap_or_default();
            line.trim().trim_end_matches([',', ';']).to_owned()
        };
        let mut slots = HashMap::new();
        let pair = |line: &&str| {
            let line = cut(line);
            let (name, number) = line.split_once(['=', ':'])?;
            let name = name.trim().trim_start_matches("par.").trim_matches('"');
            Some((name.to_owned(), value(&tokens(number), &[])))
        };
        let read: Vec<(String, f64)> = parameters.iter().filter_map(pair).collect();
        let parameters = read.into_iter().enumerate();
        let parameters = parameters.map(|(k, (name, v))| {
            slots.insert(name, k);
            (k, v)
        });
        let parameters: Vec<(usize, f64)> = parameters.collect();
        let is_input = |right: &str| {
            ["state", "thrust", "parameters", "ui", "par"]
                .iter()
                .any(|n| {
                    let rest = right.strip_prefix(n).unwrap_or("none");
                    rest.is_empty() || rest.starts_with(['[', '(', '.'])
                })
        };
        let statement = |line: &&str| {
            let line = cut(line);
            let (name, right) = line.split_once(" = ")?;
            (!is_input(right)).then(|| (name.to_owned(), tokens(right)))
        };
        let found: Vec<(String, Vec<Token>)> = body.iter().filter_map(statement).collect();
        let assigned = found.into_iter().map(|(name, tokens)| {
            let tokens = placed(tokens, &mut slots);
            let next = slots.len();
            (*slots.entry(name).or_insert(next), tokens)
        });
        let assigned = assigned.collect();
        let outputs = outputs.iter().map(|l| placed(tokens(&cut(l)), &mut slots));
        Function {
            assigned,
            outputs: outputs.collect(),
            parameters,
            slots,
        }
    }

    /// Of a file whose outputs are rates, pose, own states: pose first.
    pub fn reordered(mut self) -> Function {
        let rest = self.outputs.split_off(12);
        let pose = self.outputs.split_off(6);
        let rates = std::mem::take(&mut self.outputs);
        self.outputs = pose.into_iter().chain(rates).chain(rest).collect();
        self
    }

    /// Its rates, in the order of the file.
    pub fn rates(&self, inputs: &[(&str, f64)]) -> Vec<f64> {
        let mut values = vec![f64::NAN; self.slots.len()];
        for (place, v) in &self.parameters {
            values[*place] = *v;
        }
        for (name, v) in inputs {
            // What the formulas do not use has no place.
            if let Some(place) = self.slots.get(*name) {
                values[*place] = *v;
            }
        }
        for (place, tokens) in &self.assigned {
            values[*place] = value(tokens, &values);
        }
        self.outputs.iter().map(|t| value(t, &values)).collect()
    }
}
