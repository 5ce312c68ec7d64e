//! Declaration of messages.

/// Structs whose fields are read and written in order. A name in quotes is the type's in ROS 2, a second one the MD5 sum of ROS 1.
///
/// `[ros1] field: type` exists in ROS 1 only (and `[ros2]` in ROS 2), and otherwise has its default. `field / other: type` is called
/// `other` in ROS 1. `field: type = "text"` has the type `text` in definitions, and is omitted there if the text is empty.
macro_rules! messages {
    ($($(#[$meta:meta])* $name:ident $(<$life:lifetime>)? $ros:literal $($md5:literal)? {
        $($([$only:ident])? $field:ident $(/ $other:ident)?: $type:ty $(= $text:literal)?,)*
    })*) => {$(
        #[doc = concat!("`", $ros, "`.")]
        $(#[$meta])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $name $(<$life>)? { $(pub $field: $type,)* }

        impl $(<$life>)? $crate::describe::Message for $name $(<$life>)? {
            const NAME: &'static str = $ros;
            const ROS1_MD5: &'static str = concat!($($md5)?);
        }

        impl $(<$life>)? $crate::describe::Described for $name $(<$life>)? {
            fn type_text(_: $crate::describe::Version) -> String {
                $crate::describe::short_name($ros)
            }
            #[allow(unused_mut, unused_variables)]
            fn sections(version: $crate::describe::Version, to: &mut Vec<$crate::describe::Section>) {
                let name = Self::type_text(version);
                if to.iter().any(|s| s.name == name) {
                    return;
                }
                let mut fields = String::new();
                $(if messages!(@there version == $crate::describe::Version::Ros1, $($only)?) {
                    let text = messages!(@text $type, version, $($text)?);
                    let name = messages!(@name $field, version, $($other)?);
                    if !text.is_empty() {
                        fields += &format!("{text} {name}\n");
                    }
                })*
                to.push($crate::describe::Section { name, fields });
                $(if messages!(@there version == $crate::describe::Version::Ros1, $($only)?) {
                    <$type as $crate::describe::Described>::sections(version, to);
                })*
            }
        }

        messages!(@wire $name $(<$life>)? $ros { $($([$only])? $field)* });
    )*};
    (@wire $name:ident $ros:literal { $($fields:tt)* }) => {
        impl $crate::wire::Wire<'_> for $name { messages!(@body '_ $ros { $($fields)* }); }
    };
    (@wire $name:ident <$life:lifetime> $ros:literal { $($fields:tt)* }) => {
        impl<$life> $crate::wire::Wire<$life> for $name<$life> { messages!(@body $life $ros { $($fields)* }); }
    };
    (@body $life:lifetime $ros:literal { $($([$only:ident])? $field:ident)* }) => {
        #[allow(unused_variables)]
        fn read(from: &mut $crate::wire::Reader<$life>) -> Result<Self, $crate::wire::WireError> {
            $(let $field = if messages!(@there from.format() == $crate::wire::Format::Ros1, $($only)?) {
                $crate::wire::Wire::read(from).map_err(|e| e.within($ros, stringify!($field)))?
            } else {
                Default::default()
            };)*
            Ok(Self { $($field),* })
        }
        #[allow(unused_variables)]
        fn write(&self, to: &mut $crate::wire::Writer) {
            $(if messages!(@there to.format() == $crate::wire::Format::Ros1, $($only)?) {
                self.$field.write(to);
            })*
        }
    };
    (@text $type:ty, $version:ident,) => { <$type as $crate::describe::Described>::type_text($version) };
    (@text $type:ty, $version:ident, $text:literal) => { $text };
    (@name $field:ident, $version:ident,) => { stringify!($field).trim_start_matches("r#") };
    (@name $field:ident, $version:ident, $other:ident) => {
        if $version == $crate::describe::Version::Ros1 { stringify!($other) } else { stringify!($field) }
    };
    (@there $is_ros1:expr,) => { true };
    (@there $is_ros1:expr, ros1) => { $is_ros1 };
    (@there $is_ros1:expr, ros2) => { !($is_ros1) };
}
