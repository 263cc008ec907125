// Air temperature and humidity by an SHT4x (library Adafruit SHT4x): ms=61000, air=23.45 C, humidity=45.67 %
#include <Adafruit_SHT4x.h>

Adafruit_SHT4x sensor;

void setup() {
  Serial.begin(115200);
  sensor.begin();
}

void loop() {
  sensors_event_t humidity, temperature;
  bool good = sensor.getEvent(&humidity, &temperature);
  Serial.print("ms=");
  Serial.print(millis());
  Serial.print(", air=");
  Serial.print(good ? temperature.temperature : NAN);
  Serial.print(" C, humidity=");
  Serial.print(good ? humidity.relative_humidity : NAN);
  Serial.println(" %");
  delay(1000);
}
