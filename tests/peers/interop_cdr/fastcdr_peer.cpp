// Writes and reads a dozen message shapes with eProsima Fast-CDR, the library below rmw_fastrtps.
//
// One request a line on standard input, one answer a line on standard output:
//   write <shape> <tokens>      -> the message as hexadecimal CDR, little endian
//   write_big <shape> <tokens>  -> the same, big endian
//   read <shape> <hex>          -> <tokens>, or "refused"
// Tokens are the values in field order: integers in decimal, floats as the hexadecimal bits, strings as "s" and the
// hexadecimal bytes, wstrings as "w" and four hexadecimal digits a unit; a sequence is its length and its elements.
//
// A shape is a struct with one function that names its fields in order; the walkers below do the rest. What is tested
// is Fast-CDR's own alignment and own handling of every primitive, string, array and vector.

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

template <class T, class = void>
struct is_shape : std::false_type {};
template <class T>
struct is_shape<T, typename T::shape> : std::true_type {};

#define FIELDS(...)            \
  using shape = void;          \
  template <class W>           \
  void walk(W& w) {            \
    w.all(__VA_ARGS__);        \
  }

// --- the shapes; tests/peers/interop_cdr/test_fastcdr.py has the same as .msg text ------------------------------------------

struct Numbers {
  bool a; uint8_t b; int8_t c; int16_t d; uint8_t e; uint16_t f; uint8_t g; int32_t h; uint8_t i; uint32_t j;
  uint8_t k; int64_t l; uint8_t m; uint64_t n; uint8_t o; float p; uint8_t q; double r;
  FIELDS(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r)
};
struct Small { uint8_t a; uint16_t b; FIELDS(a, b) };
struct Wide { uint8_t a; double b; uint8_t c; FIELDS(a, b, c) };
struct Text { uint8_t a; std::string b; uint16_t c; std::string d; double e; FIELDS(a, b, c, d, e) };
struct WideText { uint8_t a; std::wstring b; uint8_t c; std::wstring d; double e; FIELDS(a, b, c, d, e) };
struct Arrays {
  uint8_t a; std::array<uint8_t, 3> b; std::array<double, 2> c; std::array<int16_t, 3> d; std::array<bool, 3> e;
  std::array<std::string, 2> f; std::array<uint64_t, 2> g;
  FIELDS(a, b, c, d, e, f, g)
};
struct Sequences {
  uint8_t a; std::vector<uint8_t> b; std::vector<double> c; uint8_t d; std::vector<bool> e; std::vector<int16_t> f;
  std::vector<uint64_t> g; std::vector<float> h; uint8_t i;
  FIELDS(a, b, c, d, e, f, g, h, i)
};
struct Texts {
  std::vector<std::string> a; uint8_t b; std::vector<std::wstring> c; std::vector<std::string> d; uint64_t e;
  FIELDS(a, b, c, d, e)
};
struct Nested { uint8_t a; Wide b; Small c; Wide d; uint8_t e; Text f; uint8_t g; FIELDS(a, b, c, d, e, f, g) };
struct Lists {
  uint8_t a; std::vector<Small> b; std::vector<Wide> c; std::vector<Text> d; std::array<Wide, 2> e; uint32_t f;
  FIELDS(a, b, c, d, e, f)
};
struct Deep { uint8_t a; std::vector<Lists> b; Nested c; std::vector<Sequences> d; FIELDS(a, b, c, d) };
struct Stamp { int32_t sec; uint32_t nanosec; FIELDS(sec, nanosec) };
struct Header { Stamp stamp; std::string frame_id; FIELDS(stamp, frame_id) };
struct JointState {
  Header header; std::vector<std::string> name; std::vector<double> position; std::vector<double> velocity;
  std::vector<double> effort;
  FIELDS(header, name, position, velocity, effort)
};

// --- walkers ----------------------------------------------------------------------------------------------------------

template <class Self>
struct Walker {
  template <class... T>
  void all(T&... fields) {
    (static_cast<Self*>(this)->one(fields), ...);
  }
};

struct ToCdr : Walker<ToCdr> {
  Cdr& cdr;
  explicit ToCdr(Cdr& c) : cdr(c) {}
  template <class T>
  void one(T& v) {
    if constexpr (is_shape<T>::value) v.walk(*this);
    else cdr << v;
  }
  template <class T>
  void one(std::vector<T>& v) {
    if constexpr (is_shape<T>::value) {
      cdr << static_cast<uint32_t>(v.size());
      for (auto& x : v) one(x);
    } else cdr << v;
  }
  template <class T, size_t N>
  void one(std::array<T, N>& v) {
    if constexpr (is_shape<T>::value) for (auto& x : v) one(x);
    else cdr << v;
  }
};

struct FromCdr : Walker<FromCdr> {
  Cdr& cdr;
  explicit FromCdr(Cdr& c) : cdr(c) {}
  template <class T>
  void one(T& v) {
    if constexpr (is_shape<T>::value) v.walk(*this);
    else cdr >> v;
  }
  template <class T>
  void one(std::vector<T>& v) {
    if constexpr (is_shape<T>::value) {
      uint32_t n = 0;
      cdr >> n;
      v.clear();
      for (uint32_t i = 0; i < n; ++i) {
        v.emplace_back();
        one(v.back());
      }
    } else cdr >> v;
  }
  template <class T, size_t N>
  void one(std::array<T, N>& v) {
    if constexpr (is_shape<T>::value) for (auto& x : v) one(x);
    else cdr >> v;
  }
};

static const char* kDigits = "0123456789abcdef";

struct ToText : Walker<ToText> {
  std::ostream& out;
  explicit ToText(std::ostream& o) : out(o) {}
  template <class T>
  void one(T& v) {
    if constexpr (is_shape<T>::value) v.walk(*this);
    else if constexpr (std::is_floating_point_v<T>) bits(v);
    else out << ' ' << +v;
  }
  template <class T>
  void bits(T v) {
    std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t> raw;
    std::memcpy(&raw, &v, sizeof raw);
    out << ' ' << std::hex << raw << std::dec;
  }
  void one(std::string& v) {
    out << " s";
    for (unsigned char c : v) out << kDigits[c >> 4] << kDigits[c & 15];
  }
  void one(std::wstring& v) {
    out << " w";
    for (wchar_t c : v) for (int shift = 12; shift >= 0; shift -= 4) out << kDigits[(c >> shift) & 15];
  }
  template <class T>
  void one(std::vector<T>& v) {
    out << ' ' << v.size();
    for (T x : v) one(x);
  }
  template <class T, size_t N>
  void one(std::array<T, N>& v) {
    for (auto& x : v) one(x);
  }
};

struct FromText : Walker<FromText> {
  std::istream& in;
  explicit FromText(std::istream& i) : in(i) {}
  std::string token() {
    std::string text;
    in >> text;
    return text;
  }
  template <class T>
  void one(T& v) {
    if constexpr (is_shape<T>::value) v.walk(*this);
    else if constexpr (std::is_floating_point_v<T>) {
      std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t> raw = std::stoull(token(), nullptr, 16);
      std::memcpy(&v, &raw, sizeof raw);
    } else if constexpr (std::is_signed_v<T>) v = static_cast<T>(std::stoll(token()));
    else v = static_cast<T>(std::stoull(token()));
  }
  void one(std::string& v) {
    std::string text = token();
    v.clear();
    for (size_t i = 1; i + 1 < text.size(); i += 2) v += static_cast<char>(std::stoi(text.substr(i, 2), nullptr, 16));
  }
  void one(std::wstring& v) {
    std::string text = token();
    v.clear();
    for (size_t i = 1; i + 3 < text.size(); i += 4) v += static_cast<wchar_t>(std::stoi(text.substr(i, 4), nullptr, 16));
  }
  template <class T>
  void one(std::vector<T>& v) {
    size_t n = std::stoull(token());
    v.clear();
    for (size_t i = 0; i < n; ++i) {
      T x{};
      one(x);
      v.push_back(x);
    }
  }
  template <class T, size_t N>
  void one(std::array<T, N>& v) {
    for (auto& x : v) one(x);
  }
};

// --- requests ---------------------------------------------------------------------------------------------------------

template <class Shape>
std::string write(std::istream& in, Cdr::Endianness order) {
  Shape value{};
  FromText from(in);
  value.walk(from);
  static std::vector<char> memory(1 << 20);
  std::fill(memory.begin(), memory.end(), 0);  // Fast-CDR skips padding without writing it
  FastBuffer buffer(memory.data(), memory.size());
  Cdr cdr(buffer, order, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  ToCdr to(cdr);
  value.walk(to);
  std::string hex;
  for (size_t i = 0; i < cdr.getSerializedDataLength(); ++i) {
    unsigned char c = static_cast<unsigned char>(buffer.getBuffer()[i]);
    hex += kDigits[c >> 4];
    hex += kDigits[c & 15];
  }
  return hex;
}

template <class Shape>
std::string read(std::istream& in) {
  std::string hex;
  in >> hex;
  std::vector<char> bytes;
  for (size_t i = 0; i + 1 < hex.size(); i += 2) bytes.push_back(static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  FastBuffer buffer(bytes.data(), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  Shape value{};
  try {
    cdr.read_encapsulation();
    FromCdr from(cdr);
    value.walk(from);
  } catch (const eprosima::fastcdr::exception::Exception&) {
    return "refused";
  }
  std::ostringstream out;
  ToText to(out);
  value.walk(to);
  return out.str();
}

template <class Shape>
std::string answer(const std::string& verb, std::istream& in) {
  if (verb == "read") return read<Shape>(in);
  return write<Shape>(in, verb == "write_big" ? Cdr::BIG_ENDIANNESS : Cdr::LITTLE_ENDIANNESS);
}

int main() {
  using Answer = std::string (*)(const std::string&, std::istream&);
  const std::map<std::string, Answer> shapes = {
      {"Numbers", answer<Numbers>},   {"Small", answer<Small>},     {"Wide", answer<Wide>},
      {"Text", answer<Text>},         {"WideText", answer<WideText>}, {"Arrays", answer<Arrays>},
      {"Sequences", answer<Sequences>}, {"Texts", answer<Texts>},   {"Nested", answer<Nested>},
      {"Lists", answer<Lists>},       {"Deep", answer<Deep>},       {"Header", answer<Header>},
      {"JointState", answer<JointState>},
  };
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream in(line);
    std::string verb, shape;
    in >> verb >> shape;
    std::cout << shapes.at(shape)(verb, in) << std::endl;
  }
  return 0;
}
