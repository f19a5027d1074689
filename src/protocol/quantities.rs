//! Quantities of steps, load bouts, alerts, live frames and ellipses: the description from which the message structures, the
//! columns of files, the types of the web page for a phone and `docs/quantities.md` are derived. The modules of these messages
//! hold the declarations.

/// A quantity of a message or a part of a message, `T`: its encoding in messages, and its names in files.
#[derive(Debug)]
pub struct Quantity<T: 'static> {
    /// Field of `T`.
    pub field: &'static str,
    /// Integer type of the field.
    pub wire_type: &'static str,
    /// Column in Parquet and CSV files, with its unit.
    pub name: &'static str,
    /// Key in JSON objects; a dot separates the keys of nested objects.
    pub key: &'static str,
    /// Unit in files; [`COUNT`] for a number of things.
    pub unit: &'static str,
    /// The integer in the field is the value in this unit, times this number.
    pub per_unit: u32,
    /// Description, one sentence.
    pub meaning: &'static str,
    /// Equation or definition.
    pub source: &'static str,
    /// True if a `T` can lack this quantity.
    pub is_optional: bool,
    /// The field's value; `None` if the `T` lacks this quantity.
    pub value: fn(&T) -> Option<i64>,
}

/// [`Quantity::unit`] of a number of things.
pub const COUNT: &str = "count";

impl<T> Quantity<T> {
    /// True for a number of things.
    pub fn is_count(&self) -> bool {
        self.unit == COUNT
    }

    /// The value in [`Quantity::unit`], in the resolution of the message; `None` if `message` lacks this quantity.
    pub fn in_unit(&self, message: &T) -> Option<f64> {
        (self.value)(message).map(|value| value as f64 / f64::from(self.per_unit))
    }

    /// The JSON object that contains the quantity, if [`Quantity::key`] is nested, and the key in that object.
    pub fn path(&self) -> (Option<&'static str>, &'static str) {
        self.key.split_once('.').map_or((None, self.key), |(object, key)| (Some(object), key))
    }
}

/// A property that some regions of a `T` can have.
#[derive(Debug)]
pub struct Flag<T: 'static> {
    /// Column in files, key in JSON objects, and field of `T`.
    pub name: &'static str,
    /// Description, one sentence.
    pub meaning: &'static str,
    /// Definition.
    pub source: &'static str,
    /// Bit i: region i has the property.
    pub regions: fn(&T) -> u8,
}

impl<T> Flag<T> {
    /// True if region number `region` has the property.
    pub fn is_set(&self, message: &T, region: usize) -> bool {
        (self.regions)(message) >> region & 1 == 1
    }
}

/// Bit i: `is_set` of region i.
pub(super) fn bits<T>(regions: &[T; 8], is_set: fn(&T) -> bool) -> u8 {
    regions.iter().enumerate().fold(0, |bits, (i, region)| bits | u8::from(is_set(region)) << i)
}

/// Declares a message structure, its conversion from the type of the pipeline, and the description of its fields. A field is
/// declared as
///
/// ```text
/// /// Meaning, one sentence on one line.
/// field: integer type = expression that computes it
///     => name_in_files as "key.in_json" [per_unit per "unit"] if other_field,
///     "Equation or definition.";
/// ```
///
/// `per_unit` is the value of the integer for one unit, such as 10 for an integer in 0.1 N. `as` is omitted if the name is also
/// the key. `if` names a field that is 0 if the quantity is absent. A field with one bit for each region is described by
/// `, flags "Definition.";`. A field without a description is not a quantity.
///
/// `fn new` names the inputs of the expressions. With `fn numbers` the structure can also be read as an array.
macro_rules! quantities {
    (
        $(#[$about:meta])*
        pub struct $struct:ident {
            $(
                #[doc = $meaning:literal]
                $(#[$attribute:meta])*
                $field:ident: $type:ty = $value:expr
                    $(=> $name:ident $(as $key:literal)? [$per_unit:literal per $unit:literal] $(if $present:ident)?,
                    $source:literal)?
                    $(, flags $flag_source:literal)?;
            )*
        }

        $(#[$about_new:meta])*
        $visibility:vis fn new$(<$real:ident: Real>)?($($input:ident: $input_type:ty),+ $(,)?);
        $($numbers:tt)*
    ) => {
        $(#[$about])*
        pub struct $struct {
            $(
                #[doc = $meaning]
                $(#[doc = concat!("\n\nIn messages: ", $per_unit, " per ", $unit, ". Source: ", $source)])?
                $(#[doc = concat!("\n\nIn messages: bit i is region i. Source: ", $flag_source)])?
                $(#[$attribute])*
                pub $field: $type,
            )*
        }

        impl $struct {
            $(#[$about_new])*
            $visibility fn new$(<$real: Real>)?($($input: $input_type),+) -> Self {
                Self { $($field: $value,)* }
            }

            $($(
                #[doc = concat!($meaning, " In ", $unit, ".")]
                pub fn $name(&self) -> f64 {
                    self.$field as f64 / f64::from($per_unit)
                }
            )?)*

            /// The quantities, in the order of their fields.
            pub const QUANTITIES: &'static [$crate::protocol::Quantity<Self>] = &[
                $($(
                    $crate::protocol::Quantity {
                        field: stringify!($field),
                        wire_type: stringify!($type),
                        name: stringify!($name),
                        key: quantities!(@key $name $($key)?),
                        unit: $unit,
                        per_unit: $per_unit,
                        meaning: $meaning.trim_ascii(),
                        source: $source,
                        is_optional: quantities!(@optional $($present)?),
                        value: |message| {
                            $(if message.$present == 0 {
                                return None;
                            })?
                            Some(message.$field as i64)
                        },
                    },
                )?)*
            ];

            /// The properties of each region, in the order of their fields.
            pub const FLAGS: &'static [$crate::protocol::Flag<Self>] = &[
                $($(
                    $crate::protocol::Flag {
                        name: stringify!($field),
                        meaning: $meaning.trim_ascii(),
                        source: $flag_source,
                        regions: |message| message.$field,
                    },
                )?)*
            ];
        }

        quantities! { @numbers $struct [$($field)*] $($numbers)* }
    };
    (@optional) => { false };
    (@optional $present:ident) => { true };
    (@key $name:ident) => { stringify!($name) };
    (@key $name:ident $key:literal) => { $key };
    (@numbers $struct:ident [$($field:ident)*]) => {};
    (@numbers $struct:ident [$($field:ident)*] fn numbers(&self) -> [$number:ty];) => {
        impl $struct {
            const NUMBERS: usize = Self::QUANTITIES.len();

            fn numbers(&self) -> [$number; Self::NUMBERS] {
                [$(self.$field,)*]
            }

            fn from_numbers([$($field,)*]: [$number; Self::NUMBERS]) -> Self {
                Self { $($field,)* }
            }
        }
    };
}
pub(super) use quantities;

/// Declares a module for `#[serde(with = "...")]` that serialises eight regions as one sequence of bytes, two for each number,
/// little endian. `$region` was declared by [`quantities!`] with `fn numbers`.
macro_rules! region_bytes {
    ($module:ident, $region:ident, $number:ty) => {
        mod $module {
            use super::$region;
            use core::fmt;
            use serde::de::{Error, Visitor};
            use serde::{Deserializer, Serializer};

            const REGION: usize = 2 * $region::NUMBERS;

            pub fn serialize<S: Serializer>(regions: &[$region; 8], serializer: S) -> Result<S::Ok, S::Error> {
                let mut bytes = [0; 8 * REGION];
                for (place, region) in bytes.chunks_exact_mut(REGION).zip(regions) {
                    let numbers = region.numbers();
                    let ((words, last_bytes), (pairs, last)) = (place.as_chunks_mut(), numbers.as_chunks());
                    // Two numbers are written at once, which takes a third of the instructions that single numbers would take.
                    for (word, &[low, high]) in words.iter_mut().zip(pairs) {
                        *word = (u32::from(low as u16) | u32::from(high as u16) << 16).to_le_bytes();
                    }
                    if let [number] = last {
                        last_bytes.copy_from_slice(&number.to_le_bytes());
                    }
                }
                serializer.serialize_bytes(&bytes)
            }

            pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[$region; 8], D::Error> {
                struct Regions;

                impl Visitor<'_> for Regions {
                    type Value = [$region; 8];

                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        write!(f, "eight regions of {REGION} bytes")
                    }

                    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Self::Value, E> {
                        if bytes.len() != 8 * REGION {
                            return Err(E::invalid_length(bytes.len(), &self));
                        }
                        let number = |i: usize| <$number>::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
                        let region = |i: usize| core::array::from_fn(|field| number($region::NUMBERS * i + field));
                        Ok(core::array::from_fn(|i| $region::from_numbers(region(i))))
                    }
                }

                deserializer.deserialize_bytes(Regions)
            }
        }
    };
}
pub(super) use region_bytes;
