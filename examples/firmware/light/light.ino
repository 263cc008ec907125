// Light by a BH1750 (library BH1750 of claws): ms=61000, lux=98760.00 lx
// The sensor's usual range ends at 54 612 lx, half of full sun; a shorter measurement extends it to 117 758 lx.
#include <BH1750.h>
#include <Wire.h>

const byte SHORT = 32;               // of the measurement time register, 69 as delivered
const float FULL_SCALE = 117758.0;   // 65535 / 1.2 * 69 / SHORT
BH1750 meter;

void setup() {
  Serial.begin(115200);
  Wire.begin();
  meter.begin();
  meter.setMTreg(SHORT);
}

void loop() {
  float lux = meter.readLightLevel();  // below zero: the sensor did not answer
  Serial.print("ms=");
  Serial.print(millis());
  Serial.print(", lux=");
  if (lux < 0 || lux >= FULL_SCALE) Serial.println(lux < 0 ? "nan" : "OL");
  else {
    Serial.print(lux);
    Serial.println(" lx");
  }
  delay(1000);
}
