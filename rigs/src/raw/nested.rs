//! Kinds of keys that hold tables, and of words that choose which keys there are.

use std::marker::PhantomData;

use super::{Described, Kind, Section, Table, Writer};

/// A table below the one that is read.
pub(crate) struct Below<T> {
    may_be_left_out: bool,
    table: PhantomData<T>,
}

/// A table that must be there; left out, it is reported once and its keys are not.
pub(crate) const fn table<T: Table>() -> Below<T> {
    Below {
        may_be_left_out: false,
        table: PhantomData,
    }
}

/// A table whose keys all take their defaults when it is left out.
pub(crate) const fn table_or_defaults<T: Table>() -> Below<T> {
    Below {
        may_be_left_out: true,
        table: PhantomData,
    }
}

impl<T: Table> Kind for Below<T> {
    type Value = T;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<T>> {
        match s.item(key) {
            Some(_) => T::read(&s.table(key)).map(Some),
            None => Some(None),
        }
    }

    fn left_out(&self, s: &Section<'_>, key: &str) -> Option<T> {
        match self.may_be_left_out {
            true => T::read(&s.table_or_default(key)),
            false => T::read(&s.table(key)),
        }
    }

    fn write(&self, w: &mut Writer, key: &str, value: &T) {
        w.table(key, value);
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, _: &'static str) {
        to.table::<T>(key, T::describe_keys);
    }
}

/// `[[key]]`: a list of tables.
pub(crate) struct Entries<T> {
    most: usize,
    table: PhantomData<T>,
}

/// Up to `most` tables; none when it is left out.
pub(crate) const fn tables<T: Table>(most: usize) -> Entries<T> {
    Entries {
        most,
        table: PhantomData,
    }
}

impl<T: Table> Kind for Entries<T> {
    type Value = Vec<T>;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<Vec<T>>> {
        // Each is read, so that all that is wrong is reported.
        let read: Vec<Option<T>> = s.tables(key, self.most).iter().map(T::read).collect();
        Some(Some(read.into_iter().collect::<Option<_>>()?))
    }

    fn left_out(&self, _: &Section<'_>, _: &str) -> Option<Vec<T>> {
        Some(Vec::new())
    }

    fn write(&self, w: &mut Writer, key: &str, value: &Vec<T>) {
        value.iter().for_each(|entry| w.entry(key, entry));
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, _: &'static str) {
        to.table::<T>(&format!("{key}[]"), T::describe_keys);
    }
}

/// Keys of a struct of their own among those of the table.
pub(crate) struct Among<T>(PhantomData<T>);

pub(crate) const fn keys_of<T: Table>() -> Among<T> {
    Among(PhantomData)
}

impl<T: Table> Kind for Among<T> {
    type Value = T;

    fn typed(&self, s: &Section<'_>, _: &str) -> Option<Option<T>> {
        T::read_keys(s).map(Some)
    }

    fn left_out(&self, _: &Section<'_>, _: &str) -> Option<T> {
        None
    }

    fn write(&self, w: &mut Writer, _: &str, value: &T) {
        value.write_keys(w);
    }

    fn describe(&self, to: &mut Described<'_>, _: &str, _: &'static str) {
        T::describe_keys(to);
    }
}

/// Declares an enum by the word that chooses in a file, each variant with its keys (rows as those of `table!`): its row in
/// a table is `keys_of()`.
///
/// `by "shape"` names the word's key, whose meaning is the enum's; `or "hold"` the word that is meant when it is left
/// out. A key of several variants is described once, as in the first.
macro_rules! shapes {
    (
        $(#[doc = $about:literal])*
        pub enum $name:ident $(: $extra:ident)? by $tag:literal $(or $default:literal)? {
            $(
                $(#[doc = $vdoc:literal])*
                $variant:ident = $word:literal $({ $(
                    $(#[doc = $doc:literal])*
                    $f:ident: $t:ty = $kind:expr,
                )* })?,
            )*
        }
    ) => {
        $(#[doc = $about])*
        #[derive(Debug, Clone, $($extra,)? PartialEq)]
        pub enum $name {
            $( $(#[doc = $vdoc])* $variant $({ $( $(#[doc = $doc])* $f: $t, )* })?, )*
        }

        impl $name {
            /// Each word with its keys.
            const KEYS: &'static [(&'static str, &'static [&'static str])] = &[$( ($word, &[$($( stringify!($f), )*)?]), )*];

            /// The word of this one.
            fn chosen(&self) -> &'static str {
                match self {
                    $( $name::$variant { .. } => $word, )*
                }
            }

            fn word() -> impl $crate::raw::Kind<Value = &'static str> {
                let word = $crate::raw::words(Self::KEYS.iter().map(|(word, _)| (*word, *word)));
                $( let word = $crate::raw::Kind::or(word, $default); )?
                word
            }
        }

        impl $crate::raw::Table for $name {
            const ABOUT: &'static str = concat!($($about, "\n"),*);

            fn read_keys(s: &$crate::raw::Section<'_>) -> Option<Self> {
                let Some(word) = $crate::raw::Kind::read(&Self::word(), s, $tag) else {
                    // Which of these belong here is unknown until the word is: blame none.
                    for key in Self::KEYS.iter().flat_map(|(_, keys)| *keys) {
                        $crate::raw::spellings(key).for_each(|key| drop(s.item(&key)));
                    }
                    return None;
                };
                $(
                    if word == $word {
                        $($( let $f = $crate::raw::Kind::read(&$crate::raw::kind_of::<$t, _>($kind), s, stringify!($f)); )*)?
                        return Some($name::$variant $({ $( $f: $f?, )* })?);
                    }
                )*
                None
            }

            fn write_keys(&self, w: &mut $crate::raw::Writer) {
                w.text($tag, self.chosen());
                match self {
                    $( $name::$variant $({ $($f,)* })? => {
                        $($( $crate::raw::Kind::write(&$crate::raw::kind_of::<$t, _>($kind), w, stringify!($f), $f); )*)?
                    } )*
                }
            }

            fn describe_keys(to: &mut $crate::raw::Described<'_>) {
                $crate::raw::Kind::describe(&Self::word(), to, $tag, Self::ABOUT);
                $($($(
                    if !to.has(stringify!($f)) {
                        let about = concat!($($doc, "\n"),*);
                        $crate::raw::Kind::describe(&$crate::raw::kind_of::<$t, _>($kind), to, stringify!($f), about);
                    }
                )*)?)*
            }
        }
    };
}
