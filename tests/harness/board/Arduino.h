// A board for sketches on this computer: prints as Arduino's Print does, and sensors that read what the test says.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

typedef uint8_t byte;
const int DEC = 10, HEX = 16;
static unsigned long now_ms = 60000;
inline unsigned long millis() { return now_ms; }
inline void delay(unsigned long ms) { now_ms += ms; }
inline float said(const char *name) { return std::strtof(std::getenv(name), nullptr); }

struct {
  void begin(long) {}
  void print(const char *text) { std::fputs(text, stdout); }
  void print(double value) {
    if (std::isnan(value) || std::isinf(value)) print(std::isnan(value) ? "nan" : "inf");
    else std::printf("%.2f", value);
  }
  void print(unsigned long value) { std::printf("%lu", value); }
  void print(byte value, int base) { std::printf(base == HEX ? "%X" : "%d", value); }
  template <typename T> void println(T value) { print(value), println(); }
  void println() { print("\r\n"); }
} Serial;

struct { void begin() {} } Wire;

struct BH1750 {
  byte register_ = 69;
  bool begin() { return true; }
  bool setMTreg(byte value) { return register_ = value; }
  float readLightLevel() { return said("COUNTS") < 0 ? -1 : said("COUNTS") / 1.2 * 69 / register_; }
};

struct Adafruit_MAX31855 {
  Adafruit_MAX31855(int) {}
  bool begin() { return true; }
  double readCelsius() { return said("CELSIUS"); }
  double readInternal() { return 22.44; }
};

typedef uint8_t DeviceAddress[8];
const float DEVICE_DISCONNECTED_C = -127;
struct OneWire { OneWire(int) {} };
struct DallasTemperature {
  DallasTemperature(OneWire *) {}
  void begin() {}
  void setResolution(int) {}
  void requestTemperatures() { now_ms += 750; }
  int getDeviceCount() { return 2; }
  bool getAddress(byte *address, int index) {
    const byte found[] = {0x28, 0xFF, 0x64, 0x1D, 0x93, 0x16, 0x03, byte(index)};
    for (int i = 0; i < 8; i++) address[i] = found[i];
    return true;
  }
  float getTempC(const byte *address) { return address[7] ? said("CELSIUS") : 21.56; }
};

struct sensors_event_t { float temperature, relative_humidity; };
struct Adafruit_SHT4x {
  bool begin() { return true; }
  bool getEvent(sensors_event_t *humidity, sensors_event_t *temperature) {
    humidity->relative_humidity = 45.67;
    temperature->temperature = said("CELSIUS");
    return !std::isnan(said("CELSIUS"));
  }
};
