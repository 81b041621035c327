//! Tables of files as they are declared: a key's name, meaning, unit, range and default stand in one row, and reading,
//! writing and the book's reference all go by it.

use super::{Described, Section, Writer};

/// A table of a file, as [`table!`] makes it.
pub(crate) trait Table: Sized {
    /// Description of the table: its doc comment.
    const ABOUT: &'static str;
    /// Reads its keys and checks what they say together; `None` = reported.
    fn read_keys(s: &Section<'_>) -> Option<Self>;
    /// Writes its keys, in the order they are declared.
    fn write_keys(&self, w: &mut Writer);
    /// Describes them in the same order.
    fn describe_keys(to: &mut Described<'_>);

    /// Reads the whole table; a key that is not declared is reported.
    fn read(s: &Section<'_>) -> Option<Self> {
        let table = Self::read_keys(s);
        s.finish();
        table
    }
}

/// Kind of a key: reading, writing and description of its value.
pub(crate) trait Kind: Sized {
    /// Type of the value that is read.
    type Value;

    /// The value as typed; `Some(None)` = left out, `None` = reported.
    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<Self::Value>>;
    /// Value of a key that was left out; `None` = reported.
    fn left_out(&self, s: &Section<'_>, key: &str) -> Option<Self::Value>;
    fn write(&self, w: &mut Writer, key: &str, value: &Self::Value);
    /// Adds the key, as one that must be there, to its table's description.
    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str);

    /// The value; `None` = reported.
    fn read(&self, s: &Section<'_>, key: &str) -> Option<Self::Value> {
        match self.typed(s, key)? {
            Some(value) => Some(value),
            None => self.left_out(s, key),
        }
    }

    /// May be left out, and nothing is assumed then.
    fn optional(self) -> Optional<Self> {
        Optional(self)
    }

    /// Is `value` when it is left out.
    fn or(self, value: Self::Value) -> Or<Self>
    where
        Self::Value: std::fmt::Display,
    {
        let said = value.to_string();
        self.or_said(value, &said)
    }

    /// Is `value` when it is left out, which the reference calls `said`.
    fn or_said(self, value: Self::Value, said: &str) -> Or<Self> {
        let left_out = LeftOut::Is {
            value,
            quiet: false,
        };
        Or {
            kind: self,
            left_out,
            said: Some(said.to_owned()),
        }
    }

    /// Follows from other keys when it is left out, which the reference calls `said`: the table's check puts it in.
    fn later(self, said: impl Into<Option<&'static str>>) -> Or<Self> {
        Or {
            kind: self,
            left_out: LeftOut::FromOthers,
            said: said.into().map(str::to_owned),
        }
    }

    /// Is read by the table's check alone, because it needs others for it: a table.
    fn by_check(self) -> Or<Self> {
        Or {
            kind: self,
            left_out: LeftOut::ByCheck,
            said: None,
        }
    }
}

/// A key that may be left out.
pub(crate) struct Optional<K>(K);

impl<K: Kind> Kind for Optional<K> {
    type Value = Option<K::Value>;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<Self::Value>> {
        Some(self.0.typed(s, key)?.map(Some))
    }

    fn left_out(&self, _: &Section<'_>, _: &str) -> Option<Self::Value> {
        Some(None)
    }

    fn write(&self, w: &mut Writer, key: &str, value: &Self::Value) {
        if let Some(value) = value {
            self.0.write(w, key, value);
        }
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str) {
        self.0.describe(to, key, about);
        to.left_out_is(None);
    }
}

/// Meaning of a key that was left out.
enum LeftOut<V> {
    /// This value, which need not be written.
    Is { value: V, quiet: bool },
    /// The table's check puts it in.
    FromOthers,
    /// The table's check reads it, typed or not.
    ByCheck,
}

/// A key with a default, of its own or from others.
pub(crate) struct Or<K: Kind> {
    kind: K,
    left_out: LeftOut<K::Value>,
    /// Default as the reference prints it; `None` = nothing is assumed.
    said: Option<String>,
}

impl<K: Kind> Or<K> {
    /// The default is not written: files of before there was this key keep their text.
    pub(crate) fn quiet(mut self) -> Self {
        if let LeftOut::Is { quiet, .. } = &mut self.left_out {
            *quiet = true;
        }
        self
    }
}

impl<K: Kind<Value: Clone + PartialEq>> Kind for Or<K> {
    type Value = K::Value;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<Self::Value>> {
        match self.left_out {
            LeftOut::ByCheck => {
                s.item(key);
                None
            }
            _ => self.kind.typed(s, key),
        }
    }

    fn left_out(&self, _: &Section<'_>, _: &str) -> Option<Self::Value> {
        match &self.left_out {
            LeftOut::Is { value, .. } => Some(value.clone()),
            _ => None,
        }
    }

    fn write(&self, w: &mut Writer, key: &str, value: &Self::Value) {
        match &self.left_out {
            LeftOut::Is { value: own, quiet } if *quiet && own == value => {}
            _ => self.kind.write(w, key, value),
        }
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str) {
        self.kind.describe(to, key, about);
        to.left_out_is(self.said.as_deref());
    }
}

/// A row's kind with the type of its field.
pub(crate) fn kind_of<V, K: Kind<Value = V>>(kind: K) -> K {
    kind
}

/// Declares a table of a file and the struct that it is once checked.
///
/// ```text
/// table! {
///     /// Description of the table; the reference omits further paragraphs.
///     pub struct Tank: Copy as TankTyped, checked by start_in_water {
///         /// Depth of the water.                                    a key, and a field of the same name
///         pub depth_m: f64 = number(0.0, 200.0, "m").above(),
///         /// Position of the CG at the start.                       a key that a field is made of; how it is written again
///         key start_m: [f64; 3] = numbers(number(-9.0, 9.0, "m")) => |t| Some(position(&t.start_pose)),
///         /// Pose of the CG at the start.                           a field that `start_in_water` makes
///         made start_pose: [f64; 6],
///     }
/// }
/// ```
///
/// Two structs come of it: `Tank`, and `TankTyped`, in which each key and each made field is an `Option` (`None` = what was
/// typed was reported). `start_in_water(&mut TankTyped, &Section)` reports what does not go together and makes what
/// is made. `key x as "y"` is for a key whose name a field has.
macro_rules! table {
    (
        $(#[doc = $about:literal])*
        $vis:vis struct $name:ident $(: $($extra:ident),+)? as $typed:ident $(, checked by $check:path)? { $($rows:tt)* }
    ) => {
        table!(@rows { [$($about)*] $vis $name [$($($extra)+)?] $typed [$($check)?] } [] [] [] $($rows)*);
    };
    (@rows { $($head:tt)* } [$($field:tt)*] [$($key:tt)*] [$($made:tt)*]
        $(#[doc = $doc:literal])* pub $f:ident: $t:ty = $kind:expr, $($rest:tt)*
    ) => {
        table!(@rows { $($head)* }
            [$($field)* { [$($doc)*] $f $t }]
            [$($key)* { [$($doc)*] $f, stringify!($f), $t, $kind, |table| Some(Clone::clone(&table.$f)) }]
            [$($made)*] $($rest)*);
    };
    (@rows { $($head:tt)* } [$($field:tt)*] [$($key:tt)*] [$($made:tt)*]
        $(#[doc = $doc:literal])* key $f:ident $(as $called:literal)?: $t:ty = $kind:expr => $get:expr, $($rest:tt)*
    ) => {
        table!(@rows { $($head)* }
            [$($field)*]
            [$($key)* { [$($doc)*] $f, table!(@called $f $($called)?), $t, $kind, $get }]
            [$($made)*] $($rest)*);
    };
    (@rows { $($head:tt)* } [$($field:tt)*] [$($key:tt)*] [$($made:tt)*]
        $(#[doc = $doc:literal])* made $f:ident: $t:ty, $($rest:tt)*
    ) => {
        table!(@rows { $($head)* } [$($field)* { [$($doc)*] $f $t }] [$($key)*] [$($made)* { $f $t }] $($rest)*);
    };
    (@called $f:ident $called:literal) => { $called };
    (@called $f:ident) => { stringify!($f) };
    (@rows { [$($about:literal)*] $vis:vis $name:ident [$($extra:ident)*] $typed:ident [$($check:path)?] }
        [$({ [$($doc:literal)*] $f:ident $ft:ty })*]
        [$({ [$($kdoc:literal)*] $k:ident, $called:expr, $kt:ty, $kind:expr, $get:expr })*]
        [$({ $m:ident $mt:ty })*]
    ) => {
        $(#[doc = $about])*
        #[derive(Debug, Clone, $($extra,)* PartialEq)]
        $vis struct $name {
            $($(#[doc = $doc])* $vis $f: $ft,)*
        }

        // Not every check looks at every key.
        #[allow(dead_code)]
        struct $typed {
            $($k: Option<$kt>,)*
            $($m: Option<$mt>,)*
        }

        #[allow(unused_variables)]
        impl $typed {
            fn read(s: &$crate::raw::Section<'_>) -> Self {
                $typed {
                    $($k: $crate::raw::Kind::read(&$crate::raw::kind_of::<$kt, _>($kind), s, $called),)*
                    $($m: None,)*
                }
            }

            fn whole(self) -> Option<$name> {
                Some($name { $($f: self.$f?,)* })
            }
        }

        #[allow(unused_variables)]
        impl $crate::raw::Table for $name {
            const ABOUT: &'static str = concat!($($about, "\n"),*);

            #[allow(unused_mut)]
            fn read_keys(s: &$crate::raw::Section<'_>) -> Option<Self> {
                let mut typed = $typed::read(s);
                $($check(&mut typed, s);)?
                typed.whole()
            }

            fn write_keys(&self, w: &mut $crate::raw::Writer) {
                $(
                    let get: fn(&$name) -> Option<$kt> = $get;
                    if let Some(value) = get(self) {
                        $crate::raw::Kind::write(&$crate::raw::kind_of::<$kt, _>($kind), w, $called, &value);
                    }
                )*
            }

            fn describe_keys(to: &mut $crate::raw::Described<'_>) {
                $(
                    let about = concat!($($kdoc, "\n"),*);
                    $crate::raw::Kind::describe(&$crate::raw::kind_of::<$kt, _>($kind), to, $called, about);
                )*
            }
        }
    };
}
