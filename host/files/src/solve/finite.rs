//! Looks for NaN and infinity in a result before it is written.
//!
//! A serializer that writes nothing: it walks the result as any other would and fails at the first number that JSON
//! cannot hold, naming its place.

use std::fmt::Display;

use serde::ser::{self, Serialize, Serializer};

use super::error::Pointer;

/// Checks every number of a result.
///
/// # Errors
/// [`Fault`] names the first that is NaN or infinite.
pub(super) fn check<T: Serialize + ?Sized>(value: &T) -> Result<(), Fault> {
    value.serialize(Walk)
}

/// A number that JSON cannot hold, or a value that cannot be serialized at all.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{what} at \"{place}\"")]
pub(super) struct Fault {
    what: String,
    place: Pointer,
}

impl Fault {
    /// Seen from further out: the place grows at its front on the way up.
    fn inside(self, outer: Pointer) -> Self {
        Self { place: outer.join(&self.place), ..self }
    }
}

impl ser::Error for Fault {
    fn custom<T: Display>(message: T) -> Self {
        Self { what: message.to_string(), place: Pointer::default() }
    }
}

/// The serializer.
struct Walk;

/// Inside an array.
struct Elements {
    index: usize,
}

impl Elements {
    fn element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Fault> {
        check(value).map_err(|fault| fault.inside(Pointer::default().index(self.index)))?;
        self.index += 1;
        Ok(())
    }
}

/// Inside an object.
#[derive(Default)]
struct Members {
    key: String,
}

fn member<T: Serialize + ?Sized>(key: &str, value: &T) -> Result<(), Fault> {
    check(value).map_err(|fault| fault.inside(Pointer::from(key)))
}

/// Accepts values of types that JSON can always hold.
macro_rules! accept {
    ($($method:ident: $type:ty,)*) => {$(
        fn $method(self, _value: $type) -> Result<(), Fault> {
            Ok(())
        }
    )*};
}

impl Serializer for Walk {
    type Ok = ();
    type Error = Fault;
    type SerializeSeq = Elements;
    type SerializeTuple = Elements;
    type SerializeTupleStruct = Elements;
    type SerializeTupleVariant = Elements;
    type SerializeMap = Members;
    type SerializeStruct = Members;
    type SerializeStructVariant = Members;

    accept! {
        serialize_bool: bool,
        serialize_i8: i8,
        serialize_i16: i16,
        serialize_i32: i32,
        serialize_i64: i64,
        serialize_u8: u8,
        serialize_u16: u16,
        serialize_u32: u32,
        serialize_u64: u64,
        serialize_char: char,
        serialize_str: &str,
        serialize_bytes: &[u8],
        serialize_unit_struct: &'static str,
    }

    fn serialize_f32(self, value: f32) -> Result<(), Fault> {
        self.serialize_f64(value.into())
    }

    fn serialize_f64(self, value: f64) -> Result<(), Fault> {
        if value.is_finite() { Ok(()) } else { Err(ser::Error::custom(value)) }
    }

    fn serialize_none(self) -> Result<(), Fault> {
        Ok(())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Fault> {
        check(value)
    }

    fn serialize_unit(self) -> Result<(), Fault> {
        Ok(())
    }

    fn serialize_unit_variant(self, _name: &'static str, _index: u32, _variant: &'static str) -> Result<(), Fault> {
        Ok(())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _name: &'static str, value: &T) -> Result<(), Fault> {
        check(value)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        _index: u32,
        variant: &'static str,
        value: &T,
    ) -> Result<(), Fault> {
        member(variant, value)
    }

    fn serialize_seq(self, _len: Option<usize>) -> Result<Elements, Fault> {
        Ok(Elements { index: 0 })
    }

    fn serialize_tuple(self, _len: usize) -> Result<Elements, Fault> {
        Ok(Elements { index: 0 })
    }

    fn serialize_tuple_struct(self, _name: &'static str, _len: usize) -> Result<Elements, Fault> {
        Ok(Elements { index: 0 })
    }

    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
        _len: usize,
    ) -> Result<Elements, Fault> {
        Ok(Elements { index: 0 })
    }

    fn serialize_map(self, _len: Option<usize>) -> Result<Members, Fault> {
        Ok(Members::default())
    }

    fn serialize_struct(self, _name: &'static str, _len: usize) -> Result<Members, Fault> {
        Ok(Members::default())
    }

    fn serialize_struct_variant(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
        _len: usize,
    ) -> Result<Members, Fault> {
        Ok(Members::default())
    }
}

/// The four kinds of array and the two of struct differ in nothing but the method's name.
macro_rules! walk {
    ($compound:ty, $trait:ident, $method:ident($($key:ident)?)) => {
        impl ser::$trait for $compound {
            type Ok = ();
            type Error = Fault;

            fn $method<T: Serialize + ?Sized>(&mut self, $($key: &'static str,)? value: &T) -> Result<(), Fault> {
                walk!(self, value $(, $key)?)
            }

            fn end(self) -> Result<(), Fault> {
                Ok(())
            }
        }
    };
    ($elements:ident, $value:ident) => { $elements.element($value) };
    ($members:ident, $value:ident, $key:ident) => { member($key, $value) };
}

walk!(Elements, SerializeSeq, serialize_element());
walk!(Elements, SerializeTuple, serialize_element());
walk!(Elements, SerializeTupleStruct, serialize_field());
walk!(Elements, SerializeTupleVariant, serialize_field());
walk!(Members, SerializeStruct, serialize_field(key));
walk!(Members, SerializeStructVariant, serialize_field(key));

impl ser::SerializeMap for Members {
    type Ok = ();
    type Error = Fault;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Fault> {
        let key = serde_json::to_value(key).map_err(ser::Error::custom)?;
        self.key = key.as_str().map_or_else(|| key.to_string(), str::to_owned);
        Ok(())
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Fault> {
        member(&self.key, value)
    }

    fn end(self) -> Result<(), Fault> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    #[derive(Clone, serde::Serialize)]
    struct Run {
        samples: Vec<(f64, Option<f32>)>,
        end: End,
        covariance: BTreeMap<String, [f64; 2]>,
    }

    #[derive(Clone, serde::Serialize)]
    enum End {
        Time(f64),
        Break { t: f64 },
    }

    fn good() -> Run {
        Run {
            samples: vec![(0.0, None), (-0.0, Some(f32::MAX))],
            end: End::Break { t: f64::MIN_POSITIVE },
            covariance: [("x/y".to_owned(), [1e300, -1e-300])].into(),
        }
    }

    #[test]
    fn the_first_number_that_json_cannot_hold_is_named() {
        assert_eq!(check(&good()), Ok(()));
        let told = |change: fn(&mut Run)| {
            let mut result = good();
            change(&mut result);
            check(&result).unwrap_err().to_string()
        };
        assert_eq!(told(|r| r.samples[1].1 = Some(f32::NAN)), r#"NaN at "/samples/1/1""#);
        assert_eq!(told(|r| r.end = End::Time(f64::INFINITY)), r#"inf at "/end/Time""#);
        assert_eq!(told(|r| r.end = End::Break { t: f64::NEG_INFINITY }), r#"-inf at "/end/t""#);
        assert_eq!(told(|r| r.covariance.get_mut("x/y").unwrap()[1] = f64::NAN), r#"NaN at "/covariance/x~1y/1""#);
    }

    proptest! {
        #[test]
        fn exactly_the_lists_of_finite_numbers_pass(numbers in proptest::collection::vec(any::<f64>(), 0..6)) {
            prop_assert_eq!(check(&numbers).is_ok(), numbers.iter().all(|x| x.is_finite()));
        }

        #[test]
        fn what_passes_comes_back_bit_for_bit(number in any::<f64>()) {
            prop_assume!(check(&number).is_ok());
            let text = serde_json::to_string(&number).unwrap();
            prop_assert_eq!(serde_json::from_str::<f64>(&text).unwrap().to_bits(), number.to_bits(), "{}", text);
        }
    }
}
