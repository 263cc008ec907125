// The last part: everything above is defined.

makeSteppers();
fitHeader();
useKey().then(tryAgain);
