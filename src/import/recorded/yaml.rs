//! YAML as far as `metadata.yaml` of bags uses it: mappings and lists by indentation or in brackets, texts plain, quoted or folded.
//!
//! Anchors, tags and several documents mean nothing here; what is none of it is an error with its line.

/// Nesting beyond which a file is no account of a bag.
const DEPTH_MAX: usize = 32;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Yaml {
    Text(String),
    List(Vec<Yaml>),
    Map(Vec<(String, Yaml)>),
}

impl Yaml {
    pub fn get(&self, key: &str) -> Option<&Yaml> {
        match self {
            Yaml::Map(entries) => entries.iter().find(|e| e.0 == key).map(|e| &e.1),
            _ => None,
        }
    }

    pub fn text(&self) -> Option<&str> {
        match self {
            Yaml::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Its elements; of what is no list none.
    pub fn list(&self) -> &[Yaml] {
        match self {
            Yaml::List(list) => list,
            _ => &[],
        }
    }

    pub fn count(&self) -> Option<u64> {
        self.text()?.parse().ok()
    }

    /// Reads a text.
    ///
    /// # Errors
    /// The line, and what is wrong in it.
    pub fn parse(text: &str) -> Result<Yaml, String> {
        let lines = text.lines().enumerate().map(|(n, line)| Line {
            number: n + 1,
            indent: line.len() - line.trim_start_matches(' ').len(),
            text: line.trim(),
        });
        let lines: Vec<Line<'_>> = lines.collect();
        let mut reader = Reader { lines, at: 0 };
        reader.skip_empty();
        let node = reader.node(0, 0)?;
        reader.skip_empty();
        match reader.line() {
            None => Ok(node),
            Some(line) => Err(line.wrong("does not belong to what stands above it")),
        }
    }
}

/// A line with its indentation; of a list's element that begins in it, the rest.
#[derive(Debug, Clone, Copy)]
struct Line<'a> {
    number: usize,
    indent: usize,
    text: &'a str,
}

impl Line<'_> {
    fn wrong(&self, what: &str) -> String {
        let shown: String = self.text.chars().take(40).collect();
        format!("line {}: '{shown}' {what}", self.number)
    }

    fn is_empty(&self) -> bool {
        let text = self.text;
        text.is_empty()
            || text.starts_with('#')
            || matches!(text, "---" | "...")
            || text.starts_with("%YAML")
    }

    fn is_element(&self) -> bool {
        self.text == "-" || self.text.starts_with("- ")
    }
}

struct Reader<'a> {
    lines: Vec<Line<'a>>,
    at: usize,
}

/// Key and what stands behind its colon, of a line of a mapping.
fn entry(text: &str) -> Option<(String, &str)> {
    if let Some(quote @ ('"' | '\'')) = text.chars().next() {
        let (key, rest) = quoted(text, quote)?;
        return Some((key, rest.trim_start().strip_prefix(':')?.trim_start()));
    }
    if text.starts_with(['{', '[']) {
        return None;
    }
    let (key, rest) = match text.split_once(": ") {
        Some(both) => both,
        None => (text.strip_suffix(':')?, ""),
    };
    Some((key.trim_end().to_owned(), rest.trim_start()))
}

/// A quoted text and what stands behind it; `None` = it is not closed.
fn quoted(text: &str, quote: char) -> Option<(String, &str)> {
    let mut out = String::new();
    let mut chars = text.char_indices().skip(1).peekable();
    while let Some((at, c)) = chars.next() {
        match c {
            '\'' if quote == '\'' && chars.peek().is_some_and(|n| n.1 == '\'') => {
                out.push('\'');
                chars.next();
            }
            '\\' if quote == '"' => match chars.next()?.1 {
                'n' => out.push('\n'),
                't' => out.push('\t'),
                other => out.push(other),
            },
            c if c == quote => return Some((out, &text[at + 1..])),
            c => out.push(c),
        }
    }
    None
}

/// A text without the remark behind it.
fn without_remark(text: &str) -> &str {
    match text.find(" #") {
        Some(at) => text[..at].trim_end(),
        None => text,
    }
}

/// A value without the tag or anchor before it.
fn without_tag(mut text: &str) -> &str {
    while text.starts_with(['!', '&']) {
        text = text
            .split_once(' ')
            .map_or("", |(_, rest)| rest.trim_start());
    }
    text
}

impl<'a> Reader<'a> {
    fn line(&self) -> Option<Line<'a>> {
        self.lines.get(self.at).copied()
    }

    fn skip_empty(&mut self) {
        while self.line().is_some_and(|l| l.is_empty()) {
            self.at += 1;
        }
    }

    /// The value that begins in this line, if it is indented enough; else an empty one.
    fn node(&mut self, least: usize, depth: usize) -> Result<Yaml, String> {
        self.skip_empty();
        let Some(line) = self.line().filter(|l| l.indent >= least) else {
            return Ok(Yaml::Text(String::new()));
        };
        if depth > DEPTH_MAX {
            return Err(line.wrong("is nested too deep"));
        }
        if line.is_element() {
            return self.list(line.indent, depth);
        }
        match entry(line.text) {
            Some(_) => self.map(line.indent, depth),
            None => self.value(line.text, line.indent.saturating_sub(1), depth),
        }
    }

    fn list(&mut self, indent: usize, depth: usize) -> Result<Yaml, String> {
        let mut list = Vec::new();
        loop {
            self.skip_empty();
            let Some(line) = self.line().filter(|l| l.indent == indent && l.is_element()) else {
                return Ok(Yaml::List(list));
            };
            let rest = line.text[1..].trim_start();
            if rest.is_empty() || rest.starts_with('#') {
                self.at += 1;
                list.push(self.node(indent + 1, depth + 1)?);
                continue;
            }
            // The rest of the line is the element's first, as deep as it stands.
            let deeper = indent + line.text.len() - rest.len();
            self.lines[self.at] = Line {
                indent: deeper,
                text: rest,
                ..line
            };
            list.push(self.node(deeper, depth + 1)?);
        }
    }

    fn map(&mut self, indent: usize, depth: usize) -> Result<Yaml, String> {
        let mut entries = Vec::new();
        loop {
            self.skip_empty();
            let Some(line) = self
                .line()
                .filter(|l| l.indent == indent && !l.is_element())
            else {
                return Ok(Yaml::Map(entries));
            };
            let Some((key, rest)) = entry(line.text) else {
                return Err(line.wrong("is no 'key: value'"));
            };
            let rest = without_tag(rest);
            let value = if rest.is_empty() || rest.starts_with('#') {
                self.at += 1;
                self.skip_empty();
                // A list may stand as deep as its key.
                let own_list = self
                    .line()
                    .is_some_and(|l| l.indent == indent && l.is_element());
                match own_list {
                    true => self.list(indent, depth + 1)?,
                    false => self.node(indent + 1, depth + 1)?,
                }
            } else {
                self.value(rest, indent, depth + 1)?
            };
            entries.push((key, value));
        }
    }

    /// A text or what is in brackets, from this line on; lines that are indented deeper than `indent` may belong to it.
    fn value(&mut self, first: &str, indent: usize, depth: usize) -> Result<Yaml, String> {
        let line = self.lines[self.at];
        self.at += 1;
        let mut text = first.to_owned();
        match first.chars().next() {
            Some('|' | '>') => {
                text.clear();
                while let Some(next) = self
                    .line()
                    .filter(|l| l.indent > indent || l.text.is_empty())
                {
                    text.push_str(next.text);
                    text.push('\n');
                    self.at += 1;
                }
                Ok(Yaml::Text(text))
            }
            Some(quote @ ('"' | '\'')) => self
                .closed(text, |text| quoted(text, quote))
                .map(Yaml::Text)
                .ok_or_else(|| line.wrong("has a quote that is not closed")),
            Some('[' | '{') => self
                .closed(text, |text| bracketed(text, depth))
                .ok_or_else(|| line.wrong("has a bracket that is not closed")),
            _ => {
                text = without_remark(&text).to_owned();
                while let Some(next) = self.line().filter(|l| l.indent > indent && !l.is_empty()) {
                    text.push(' ');
                    text.push_str(without_remark(next.text));
                    self.at += 1;
                }
                Ok(Yaml::Text(text))
            }
        }
    }
}

impl Reader<'_> {
    /// What `parse` finds in a text that may go on in the lines from here, which it takes; it returns the rest, or `None` while the
    /// text is not closed. Twice as many lines are tried each time, so that a text costs what it is long.
    fn closed<T>(
        &mut self,
        mut text: String,
        parse: impl Fn(&str) -> Option<(T, &str)>,
    ) -> Option<T> {
        let start = self.at;
        loop {
            if let Some((node, rest)) = parse(&text) {
                self.at -= rest.matches('\n').count();
                return Some(node);
            }
            let more = (self.at - start + 1).min(self.lines.len() - self.at);
            if more == 0 {
                return None;
            }
            for line in &self.lines[self.at..self.at + more] {
                text.push('\n');
                text.push_str(line.text);
            }
            self.at += more;
        }
    }
}

/// What stands in brackets, and the rest; `None` = they are not closed yet, or it is nested too deep.
fn bracketed(text: &str, depth: usize) -> Option<(Yaml, &str)> {
    if depth > DEPTH_MAX {
        return None;
    }
    let is_map = text.starts_with('{');
    let close = if is_map { '}' } else { ']' };
    let (mut list, mut entries) = (Vec::new(), Vec::new());
    let mut rest = text.get(1..)?.trim_start();
    loop {
        if let Some(behind) = rest.strip_prefix(close) {
            let node = match is_map {
                true => Yaml::Map(entries),
                false => Yaml::List(list),
            };
            return Some((node, behind));
        }
        let (node, behind) = flow(rest, is_map, depth)?;
        rest = behind.trim_start();
        match (is_map, node, rest.strip_prefix(':')) {
            (true, Yaml::Text(key), Some(value)) => {
                let (value, behind) = flow(value.trim_start(), false, depth)?;
                entries.push((key, value));
                rest = behind.trim_start();
            }
            (true, Yaml::Text(key), None) => entries.push((key, Yaml::Text(String::new()))),
            (_, node, _) => list.push(node),
        }
        rest = rest.strip_prefix(',').unwrap_or(rest).trim_start();
    }
}

/// A value within brackets, and the rest.
fn flow(text: &str, is_key: bool, depth: usize) -> Option<(Yaml, &str)> {
    match text.chars().next()? {
        '[' | '{' => bracketed(text, depth + 1),
        quote @ ('"' | '\'') => quoted(text, quote).map(|(own, rest)| (Yaml::Text(own), rest)),
        _ => {
            let ends = |c: char| matches!(c, ',' | ']' | '}') || (is_key && c == ':');
            let at = text.find(ends)?;
            // A closing bracket of the other kind ends nothing; it is taken with what it closes nowhere.
            let at = if at == 0 { 1 } else { at };
            Some((Yaml::Text(text[..at].trim().to_owned()), &text[at..]))
        }
    }
}

#[cfg(test)]
mod tests;
