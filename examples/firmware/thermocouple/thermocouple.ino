// A thermocouple by a MAX31855 (library Adafruit MAX31855): ms=61000, T1=48.25 C, cold_junction=22.44 C
#include <Adafruit_MAX31855.h>

const int CHIP_SELECT = 10;
Adafruit_MAX31855 amplifier(CHIP_SELECT);

void setup() {
  Serial.begin(115200);
  amplifier.begin();
}

void loop() {
  Serial.print("ms=");
  Serial.print(millis());
  Serial.print(", T1=");
  Serial.print(amplifier.readCelsius());  // nan while it is open or short-circuited
  Serial.print(" C, cold_junction=");
  Serial.print(amplifier.readInternal());
  Serial.println(" C");
  delay(1000);
}
