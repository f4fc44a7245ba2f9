/// Defines an enum whose values have a stable code each, written `GaveWay = "gave_way"`: their names in files and on
/// the network, which never change. Adds `ALL`, the values in order, `code` and its inverse `of_code`; serde uses the
/// codes.
#[macro_export]
macro_rules! coded_enum {
    ($(#[$about:meta])* pub enum $name:ident { $($(#[$of_value:meta])* $value:ident = $code:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $($(#[$of_value])* #[serde(rename = $code)] $value,)+
        }

        impl $name {
            /// Every value.
            pub const ALL: [Self; [$($code),+].len()] = [$(Self::$value),+];

            /// The name in files and on the network, which never changes.
            pub fn code(self) -> &'static str {
                match self {
                    $(Self::$value => $code,)+
                }
            }

            /// The value with this code.
            pub fn of_code(code: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|value| value.code() == code)
            }
        }
    };
}
